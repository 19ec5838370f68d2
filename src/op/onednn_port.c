#include "op/onednn_port.h"
#include <string.h>

enum v2v_status onednn_check(dnnl_status_t status, const char *what)
{
    if (status == dnnl_success) {
        return V2V_OK;
    }
    if (status == dnnl_out_of_memory) {
        return V2V_FAIL(V2V_E_MEMORY, "oneDNN %s: out of memory", what);
    }
    return V2V_FAIL(V2V_E_INTERNAL, "oneDNN %s: status %d", what, (int)status);
}

void onednn_run(const struct onednn *dnnl, dnnl_primitive_t primitive, int count,
                const dnnl_exec_arg_t *args)
{
    dnnl_status_t status = dnnl_primitive_execute(primitive, dnnl->stream, count, args);
    V2V_ASSERT(status == dnnl_success);
}

void onednn_point(dnnl_memory_t memory, const float *data)
{
    dnnl_status_t status = dnnl_memory_set_data_handle(memory, (void *)(uintptr_t)data);
    V2V_ASSERT(status == dnnl_success);
}

enum v2v_status onednn_primitive(dnnl_primitive_t *primitive, dnnl_primitive_desc_t description)
{
    dnnl_status_t status = dnnl_primitive_create(primitive, description);
    dnnl_primitive_desc_destroy(description);
    return onednn_check(status, "primitive");
}

int64_t port_floats(const dnnl_memory_desc_t *desc)
{
    return (int64_t)((dnnl_memory_desc_get_size(desc) + sizeof(float) - 1) / sizeof(float));
}

/** The rows of the image that the strip at `first` holds. With a step the strip is the whole image:
 *  its row `offset` is image row 0. */
static struct window place(const struct port *port, int64_t first, int64_t from)
{
    if (port->step > 1) {
        return (struct window){.offset = -first, .rows = port->height};
    }
    int64_t begin = first > from ? first : from;
    int64_t end = first + port->rows < port->height ? first + port->rows : port->height;
    return (struct window){.offset = begin - first, .rows = end - begin};
}

static const struct window *find(const struct port *port, struct window wanted)
{
    for (int i = 0; i < port->count; i++) {
        if (port->windows[i].offset == wanted.offset && port->windows[i].rows == wanted.rows) {
            return &port->windows[i];
        }
    }
    return NULL;
}

/** The window's part of the strip; with a step every step-th pixel of it: a description with the
 *  strides of y and x stretched (neither is an inner block in any layout of oneDNN). */
static enum v2v_status strip_view(dnnl_memory_desc_t *view, const struct port *port,
                                  const struct window *window)
{
    enum v2v_status rc = V2V_OK;
    int64_t rows = (window->rows - 1) * port->step + 1;
    int64_t columns = (port->width - 1) * port->step + 1;
    V2V_TRY(onednn_check(dnnl_memory_desc_init_submemory(
                             view, &port->desc, (dnnl_dims_t){1, port->channels, rows, columns},
                             (dnnl_dims_t){0, 0, window->offset, 0}),
                         "window"));
    if (port->step > 1) {
        view->dims[2] = view->padded_dims[2] = window->rows;
        view->dims[3] = view->padded_dims[3] = port->width;
        view->format_desc.blocking.strides[2] *= port->step;
        view->format_desc.blocking.strides[3] *= port->step;
    }
done:
    return rc;
}

enum v2v_status port_prepare(struct port *port, const struct onednn *dnnl, int64_t first,
                             int64_t from)
{
    enum v2v_status rc = V2V_OK;
    struct window wanted = place(port, first, from);
    dnnl_memory_desc_t plain, strip;
    dnnl_primitive_desc_t reorder = NULL;
    if (find(port, wanted) != NULL) {
        return V2V_OK;
    }
    V2V_ASSERT(port->count < PORT_WINDOWS);
    struct window *window = &port->windows[port->count++];
    *window = wanted;
    int64_t plane = port->height * port->width;
    V2V_TRY(
        onednn_check(dnnl_memory_desc_init_by_strides(
                         &plain, 4, (dnnl_dims_t){1, port->channels, window->rows, port->width},
                         dnnl_f32, (dnnl_dims_t){port->channels * plane, plane, port->width, 1}),
                     "image"));
    V2V_TRY(strip_view(&strip, port, window));
    const dnnl_memory_desc_t *source = port->direction == PORT_LOAD ? &plain : &strip;
    const dnnl_memory_desc_t *target = port->direction == PORT_LOAD ? &strip : &plain;
    V2V_TRY(onednn_check(dnnl_reorder_primitive_desc_create(&reorder, source, dnnl->engine, target,
                                                            dnnl->engine, NULL),
                         "reorder of rows"));
    V2V_TRY(onednn_primitive(&window->reorder, reorder));
    V2V_TRY(onednn_check(dnnl_memory_create(&window->plain, &plain, dnnl->engine, DNNL_MEMORY_NONE),
                         "memory"));
    V2V_TRY(onednn_check(dnnl_memory_create(&window->strip, &strip, dnnl->engine, port->memory),
                         "memory"));
done:
    return rc;
}

static void clear(float *strip, int64_t floats)
{
    enum { BLOCK = 16384 };
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < floats; i += BLOCK) {
        int64_t count = floats - i < BLOCK ? floats - i : BLOCK;
        memset(strip + i, 0, (size_t)count * sizeof *strip);
    }
}

void port_load(const struct port *port, const struct onednn *dnnl, const float *image,
               int64_t first, int64_t from)
{
    struct window wanted = place(port, first, from);
    const struct window *window = find(port, wanted);
    V2V_ASSERT(window != NULL && port->direction == PORT_LOAD);
    if (window->rows < port->rows) {
        clear(port->memory, port->floats);
    }
    int64_t row = port->step > 1 ? 0 : first + wanted.offset;
    onednn_point(window->plain, image + row * port->width);
    onednn_run(dnnl, window->reorder, 2,
               (dnnl_exec_arg_t[]){{DNNL_ARG_FROM, window->plain}, {DNNL_ARG_TO, window->strip}});
}

void port_store(const struct port *port, const struct onednn *dnnl, float *image, int64_t first)
{
    const struct window *window = find(port, place(port, first, first));
    V2V_ASSERT(window != NULL && port->direction == PORT_STORE);
    onednn_point(window->plain, image + first * port->width);
    onednn_run(dnnl, window->reorder, 2,
               (dnnl_exec_arg_t[]){{DNNL_ARG_FROM, window->strip}, {DNNL_ARG_TO, window->plain}});
}

void port_fini(struct port *port)
{
    for (int i = 0; i < port->count; i++) {
        dnnl_memory_destroy(port->windows[i].plain);
        dnnl_memory_destroy(port->windows[i].strip);
        dnnl_primitive_destroy(port->windows[i].reorder);
    }
    port->count = 0;
}
