#include "op/conv_backend.h"
#include "op/isa.h"
#include "op/onednn_port.h"
#include "v2v3d/base/memory.h"
#include <omp.h>

/** Bytes of a task's two strips: they stay in a cache of the second or third level, and each thread
 *  has rows to work on. */
static const int64_t STRIP_BYTES = 16 << 20;
static const int64_t STRIP_BYTES_PER_THREAD = 4 << 20;

/** One of the three computations of a layer, over strips of `rows` output rows.
 *  The data gradient is a convolution too: of dout (for stride 2 with zeros between its pixels:
 * four times the work, but for the one small layer of that kind) with flipped, transposed weights.
 */
struct task {
    dnnl_data_type_t type; /**< of both strips, and of the weights that are multiplied */
    int64_t in, out;       /**< channels */
    int64_t width;         /**< of the strip read */
    int64_t rows, columns; /**< of the strip at the output */
    int64_t height;        /**< rows of the whole output */
    int kernel, stride;
    float slope;
    struct port read, other; /**< other: what is written, or dout in the gradient of the weights */
    dnnl_memory_desc_t weights_desc;
    dnnl_primitive_t primitive;
    dnnl_primitive_t reorder; /**< of the weights: from the caller's, of their gradient: to them */
    dnnl_memory_t strip_read, strip_other, weights, plain;
    float *packed; /**< weights in oneDNN's layout and type, or a strip's share of their gradient */
};

struct state {
    struct v2v_conv_spec spec;
    struct onednn dnnl;
    struct task forward, data, gradient;
    dnnl_memory_t bias;
    float *strips[2];
    float *scratch; /**< flipped weights; sum of the gradient's shares */
    dnnl_memory_t scratch_memory;
};

static void choose_rows(struct task *task)
{
    int64_t budget = STRIP_BYTES_PER_THREAD * omp_get_max_threads();
    budget = budget > STRIP_BYTES ? budget : STRIP_BYTES;
    int64_t row = task->in * task->stride * task->width + task->out * task->columns;
    int64_t most = budget / (row * (int64_t)dnnl_data_type_size(task->type));
    most = most < 1 ? 1 : most;
    int64_t strips = (task->height + most - 1) / most;
    task->rows = (task->height + strips - 1) / strips;
}

static int64_t strip_count(const struct task *task)
{
    return (task->height + task->rows - 1) / task->rows;
}

/** The last strip overlaps the one before where the rows do not divide. */
static int64_t strip_start(const struct task *task, int64_t strip)
{
    int64_t last = task->height - task->rows;
    return strip * task->rows < last ? strip * task->rows : last;
}

/** First row that a strip reads, in rows of what is read. */
static int64_t read_start(const struct task *task, int64_t strip)
{
    return strip_start(task, strip) * task->stride - (task->kernel - 1) / 2;
}

static int64_t rows_read(const struct task *task)
{
    return (task->rows - 1) * task->stride + task->kernel;
}

struct shapes {
    dnnl_memory_desc_t read, weights, bias, written;
    dnnl_dims_t strides, before, after;
};

/** Shapes of a strip's convolution with layouts of oneDNN's choice; a gradient of weights is a
 *  float32 sum whatever is multiplied. */
static enum v2v_status describe(struct shapes *shapes, const struct task *task,
                                dnnl_data_type_t weights)
{
    enum v2v_status rc = V2V_OK;
    int64_t k = task->kernel, before = (k - 1) / 2;
    int64_t after = (task->columns - 1) * task->stride + k - task->width - before;
    *shapes = (struct shapes){.strides = {task->stride, task->stride},
                              .before = {0, before},
                              .after = {0, after > 0 ? after : 0}};
    V2V_TRY(onednn_check(
        dnnl_memory_desc_init_by_tag(&shapes->read, 4,
                                     (dnnl_dims_t){1, task->in, rows_read(task), task->width},
                                     task->type, dnnl_format_tag_any),
        "shape"));
    V2V_TRY(onednn_check(
        dnnl_memory_desc_init_by_tag(&shapes->written, 4,
                                     (dnnl_dims_t){1, task->out, task->rows, task->columns},
                                     task->type, dnnl_format_tag_any),
        "shape"));
    V2V_TRY(onednn_check(dnnl_memory_desc_init_by_tag(&shapes->weights, 4,
                                                      (dnnl_dims_t){task->out, task->in, k, k},
                                                      weights, dnnl_format_tag_any),
                         "shape"));
    V2V_TRY(onednn_check(
        dnnl_memory_desc_init_by_tag(&shapes->bias, 1, (dnnl_dims_t){task->out}, dnnl_f32, dnnl_a),
        "shape"));
done:
    return rc;
}

/** Convolution with leaky ReLU behind it; the layouts chosen go into the task. */
static enum v2v_status plan_convolution(struct task *task, const struct onednn *dnnl, int with_bias)
{
    enum v2v_status rc = V2V_OK;
    struct shapes shapes;
    dnnl_convolution_desc_t convolution;
    dnnl_primitive_desc_t plan = NULL;
    dnnl_primitive_attr_t attributes = NULL;
    dnnl_post_ops_t after = NULL;
    V2V_TRY(describe(&shapes, task, task->type));
    V2V_TRY(onednn_check(dnnl_convolution_forward_desc_init(
                             &convolution, dnnl_forward_inference, dnnl_convolution_direct,
                             &shapes.read, &shapes.weights, with_bias ? &shapes.bias : NULL,
                             &shapes.written, shapes.strides, shapes.before, shapes.after),
                         "convolution"));
    V2V_TRY(onednn_check(dnnl_primitive_attr_create(&attributes), "attributes"));
    V2V_TRY(onednn_check(dnnl_post_ops_create(&after), "post-operations"));
    if (task->slope != 1.0f) {
        V2V_TRY(onednn_check(
            dnnl_post_ops_append_eltwise(after, 1.0f, dnnl_eltwise_relu, task->slope, 0.0f),
            "activation"));
        V2V_TRY(onednn_check(dnnl_primitive_attr_set_post_ops(attributes, after), "activation"));
    }
    V2V_TRY(onednn_check(
        dnnl_primitive_desc_create(&plan, &convolution, attributes, dnnl->engine, NULL),
        "convolution"));
    task->read.desc = *dnnl_primitive_desc_query_md(plan, dnnl_query_src_md, 0);
    task->other.desc = *dnnl_primitive_desc_query_md(plan, dnnl_query_dst_md, 0);
    task->weights_desc = *dnnl_primitive_desc_query_md(plan, dnnl_query_weights_md, 0);
    V2V_TRY(onednn_primitive(&task->primitive, plan));
done:
    dnnl_post_ops_destroy(after);
    dnnl_primitive_attr_destroy(attributes);
    return rc;
}

static enum v2v_status plan_gradient(struct task *task, const struct onednn *dnnl)
{
    enum v2v_status rc = V2V_OK;
    struct shapes shapes, like;
    dnnl_convolution_desc_t forward, backward;
    dnnl_primitive_desc_t hint = NULL, plan = NULL;
    V2V_TRY(describe(&like, task, task->type));
    V2V_TRY(describe(&shapes, task, dnnl_f32));
    V2V_TRY(onednn_check(dnnl_convolution_forward_desc_init(&forward, dnnl_forward_training,
                                                            dnnl_convolution_direct, &like.read,
                                                            &like.weights, NULL, &like.written,
                                                            like.strides, like.before, like.after),
                         "convolution"));
    V2V_TRY(onednn_check(dnnl_primitive_desc_create(&hint, &forward, NULL, dnnl->engine, NULL),
                         "convolution"));
    V2V_TRY(onednn_check(dnnl_convolution_backward_weights_desc_init(
                             &backward, dnnl_convolution_direct, &shapes.read, &shapes.weights,
                             NULL, &shapes.written, shapes.strides, shapes.before, shapes.after),
                         "gradient of weights"));
    V2V_TRY(onednn_check(dnnl_primitive_desc_create(&plan, &backward, NULL, dnnl->engine, hint),
                         "gradient of weights"));
    task->read.desc = *dnnl_primitive_desc_query_md(plan, dnnl_query_src_md, 0);
    task->other.desc = *dnnl_primitive_desc_query_md(plan, dnnl_query_diff_dst_md, 0);
    task->weights_desc = *dnnl_primitive_desc_query_md(plan, dnnl_query_diff_weights_md, 0);
    V2V_TRY(onednn_primitive(&task->primitive, plan));
done:
    dnnl_primitive_desc_destroy(hint);
    return rc;
}

/** The reorder between the caller's weights and oneDNN's: packing, or adding a gradient. */
static enum v2v_status plan_weights(struct task *task, const struct onednn *dnnl, int gradient)
{
    enum v2v_status rc = V2V_OK;
    int64_t k = task->kernel;
    dnnl_memory_desc_t plain;
    dnnl_primitive_desc_t plan = NULL;
    dnnl_primitive_attr_t attributes = NULL;
    dnnl_post_ops_t after = NULL;
    V2V_TRY(onednn_check(dnnl_memory_desc_init_by_tag(&plain, 4,
                                                      (dnnl_dims_t){task->out, task->in, k, k},
                                                      dnnl_f32, dnnl_oihw),
                         "weights"));
    V2V_TRY(onednn_check(dnnl_memory_create(&task->plain, &plain, dnnl->engine, DNNL_MEMORY_NONE),
                         "weights"));
    V2V_TRY(onednn_check(
        dnnl_memory_create(&task->weights, &task->weights_desc, dnnl->engine, task->packed),
        "weights"));
    V2V_TRY(onednn_check(dnnl_primitive_attr_create(&attributes), "attributes"));
    V2V_TRY(onednn_check(dnnl_post_ops_create(&after), "post-operations"));
    if (gradient) {
        V2V_TRY(onednn_check(dnnl_post_ops_append_sum(after, 1.0f), "sum"));
        V2V_TRY(onednn_check(dnnl_primitive_attr_set_post_ops(attributes, after), "sum"));
    }
    V2V_TRY(onednn_check(dnnl_reorder_primitive_desc_create(
                             &plan, gradient ? &task->weights_desc : &plain, dnnl->engine,
                             gradient ? &plain : &task->weights_desc, dnnl->engine, attributes),
                         "reorder of weights"));
    V2V_TRY(onednn_primitive(&task->reorder, plan));
done:
    dnnl_post_ops_destroy(after);
    dnnl_primitive_attr_destroy(attributes);
    return rc;
}

/** Strips' memory and reorders, once all layouts are known. */
static enum v2v_status connect(struct task *task, const struct onednn *dnnl, float *const strips[2])
{
    enum v2v_status rc = V2V_OK;
    struct port *ports[] = {&task->read, &task->other};
    dnnl_memory_t *memories[] = {&task->strip_read, &task->strip_other};
    for (int i = 0; i < 2; i++) {
        ports[i]->memory = strips[i];
        ports[i]->floats = port_floats(&ports[i]->desc);
        V2V_TRY(onednn_check(
            dnnl_memory_create(memories[i], &ports[i]->desc, dnnl->engine, strips[i]), "strip"));
    }
    task->read.rows = rows_read(task);
    task->other.rows = task->rows;
    for (int64_t strip = 0; strip < strip_count(task); strip++) {
        V2V_TRY(port_prepare(&task->read, dnnl, read_start(task, strip), 0));
        V2V_TRY(port_prepare(&task->other, dnnl, strip_start(task, strip),
                             task->other.direction == PORT_LOAD ? strip * task->rows : 0));
    }
done:
    return rc;
}

static void define_tasks(struct state *state, const struct v2v_conv_spec *spec,
                         dnnl_data_type_t type)
{
    int64_t rows = conv_out_height(spec), columns = conv_out_width(spec);
    struct port image = {.direction = PORT_LOAD,
                         .channels = spec->in,
                         .height = spec->height,
                         .width = spec->width,
                         .step = 1};
    struct port result = {.direction = PORT_STORE,
                          .channels = spec->out,
                          .height = rows,
                          .width = columns,
                          .step = 1};
    state->forward = (struct task){.type = type,
                                   .in = spec->in,
                                   .out = spec->out,
                                   .width = spec->width,
                                   .columns = columns,
                                   .height = rows,
                                   .kernel = spec->kernel,
                                   .stride = spec->stride,
                                   .slope = spec->slope,
                                   .read = image,
                                   .other = result};
    state->gradient = state->forward;
    state->gradient.other.direction = PORT_LOAD;
    choose_rows(&state->forward);
    state->gradient.rows = state->forward.rows;

    state->data = (struct task){.type = type,
                                .in = spec->out,
                                .out = spec->in,
                                .width = spec->width,
                                .columns = spec->width,
                                .height = spec->height,
                                .kernel = spec->kernel,
                                .stride = 1,
                                .slope = 1.0f,
                                .read = result,
                                .other = image};
    state->data.read.direction = PORT_LOAD;
    state->data.read.step = spec->stride;
    state->data.other.direction = PORT_STORE;
    if (spec->stride == 1) {
        choose_rows(&state->data);
    } else {
        state->data.rows = spec->height;
    }
}

static enum v2v_status allocate(struct state *state)
{
    enum v2v_status rc = V2V_OK;
    struct task *tasks[] = {&state->forward, &state->data, &state->gradient};
    int count = state->spec.training ? 3 : 1;
    int64_t floats[2] = {0};
    for (int i = 0; i < count; i++) {
        int64_t need[] = {port_floats(&tasks[i]->read.desc), port_floats(&tasks[i]->other.desc)};
        for (int j = 0; j < 2; j++) {
            floats[j] = need[j] > floats[j] ? need[j] : floats[j];
        }
        V2V_TRY(V2V_ALLOC(tasks[i]->packed, "conv.weights", port_floats(&tasks[i]->weights_desc)));
    }
    for (int j = 0; j < 2; j++) {
        V2V_TRY(V2V_ALLOC(state->strips[j], "conv.strips", floats[j]));
    }
    if (state->spec.training) {
        int64_t plain = state->spec.in * state->spec.out * state->spec.kernel * state->spec.kernel;
        int64_t packed = port_floats(&state->gradient.weights_desc);
        V2V_TRY(V2V_ALLOC(state->scratch, "conv.weights", packed > plain ? packed : plain));
    }
done:
    return rc;
}

static void task_fini(struct task *task)
{
    port_fini(&task->read);
    port_fini(&task->other);
    dnnl_memory_destroy(task->strip_read);
    dnnl_memory_destroy(task->strip_other);
    dnnl_memory_destroy(task->weights);
    dnnl_memory_destroy(task->plain);
    dnnl_primitive_destroy(task->reorder);
    dnnl_primitive_destroy(task->primitive);
    v2v_mem_free(task->packed);
}

static void destroy(void *opaque)
{
    struct state *state = opaque;
    if (state == NULL) {
        return;
    }
    task_fini(&state->forward);
    task_fini(&state->data);
    task_fini(&state->gradient);
    dnnl_memory_destroy(state->bias);
    dnnl_memory_destroy(state->scratch_memory);
    dnnl_stream_destroy(state->dnnl.stream);
    dnnl_engine_destroy(state->dnnl.engine);
    v2v_mem_free(state->strips[0]);
    v2v_mem_free(state->strips[1]);
    v2v_mem_free(state->scratch);
    v2v_mem_free(state);
}

static enum v2v_status create_training(struct state *state)
{
    enum v2v_status rc = V2V_OK;
    const struct onednn *dnnl = &state->dnnl;
    V2V_TRY(plan_weights(&state->data, dnnl, 0));
    V2V_TRY(plan_weights(&state->gradient, dnnl, 1));
    V2V_TRY(connect(&state->data, dnnl, state->strips));
    V2V_TRY(connect(&state->gradient, dnnl, state->strips));
    V2V_TRY(onednn_check(dnnl_memory_create(&state->scratch_memory, &state->gradient.weights_desc,
                                            dnnl->engine, state->scratch),
                         "weights"));
done:
    return rc;
}

static enum v2v_status create_of_type(void **opaque, const struct v2v_conv_spec *spec,
                                      dnnl_data_type_t type)
{
    enum v2v_status rc = V2V_OK;
    dnnl_memory_desc_t bias;
    struct state *state = NULL;
    V2V_TRY(V2V_ALLOC(state, "conv", 1));
    state->spec = *spec;
    struct onednn *dnnl = &state->dnnl;
    (void)v2v_onednn_isa();
    V2V_TRY(onednn_check(dnnl_engine_create(&dnnl->engine, dnnl_cpu, 0), "engine"));
    V2V_TRY(onednn_check(dnnl_stream_create(&dnnl->stream, dnnl->engine, dnnl_stream_default_flags),
                         "stream"));
    define_tasks(state, spec, type);
    V2V_TRY(plan_convolution(&state->forward, dnnl, 1));
    if (spec->training) {
        V2V_TRY(plan_convolution(&state->data, dnnl, 0));
        V2V_TRY(plan_gradient(&state->gradient, dnnl));
    }
    V2V_TRY(allocate(state));
    V2V_TRY(onednn_check(
        dnnl_memory_desc_init_by_tag(&bias, 1, (dnnl_dims_t){spec->out}, dnnl_f32, dnnl_a),
        "bias"));
    V2V_TRY(onednn_check(dnnl_memory_create(&state->bias, &bias, dnnl->engine, DNNL_MEMORY_NONE),
                         "bias"));
    V2V_TRY(plan_weights(&state->forward, dnnl, 0));
    V2V_TRY(connect(&state->forward, dnnl, state->strips));
    if (spec->training) {
        V2V_TRY(create_training(state));
    }
    *opaque = state;
    state = NULL;
done:
    destroy(state);
    return rc;
}

static enum v2v_status create(void **opaque, const struct v2v_conv_spec *spec)
{
    return create_of_type(opaque, spec, dnnl_f32);
}

static enum v2v_status create_bf16(void **opaque, const struct v2v_conv_spec *spec)
{
    return create_of_type(opaque, spec, dnnl_bf16);
}

static void pack(struct task *task, const struct onednn *dnnl, const float *weight)
{
    onednn_point(task->plain, weight);
    onednn_run(dnnl, task->reorder, 2,
               (dnnl_exec_arg_t[]){{DNNL_ARG_FROM, task->plain}, {DNNL_ARG_TO, task->weights}});
}

static void set_weights(void *opaque, const float *weight, const float *bias)
{
    struct state *state = opaque;
    onednn_point(state->bias, bias);
    pack(&state->forward, &state->dnnl, weight);
    if (state->spec.training) {
        v2v_conv_flip_weights(state->scratch, weight, &state->spec);
        pack(&state->data, &state->dnnl, state->scratch);
    }
    dnnl_stream_wait(state->dnnl.stream);
}

static void convolve(const struct state *state, const struct task *task, float *out,
                     const float *in)
{
    const struct onednn *dnnl = &state->dnnl;
    int64_t in_image = task->in * task->read.height * task->read.width;
    int64_t out_image = task->out * task->other.height * task->other.width;
    /* The data gradient's primitive was made without a bias and is not given one. */
    int arguments = task == &state->forward ? 4 : 3;
    for (int64_t n = 0; n < state->spec.batch; n++) {
        for (int64_t strip = 0; strip < strip_count(task); strip++) {
            port_load(&task->read, dnnl, in + n * in_image, read_start(task, strip), 0);
            onednn_run(dnnl, task->primitive, arguments,
                       (dnnl_exec_arg_t[]){{DNNL_ARG_SRC, task->strip_read},
                                           {DNNL_ARG_WEIGHTS, task->weights},
                                           {DNNL_ARG_DST, task->strip_other},
                                           {DNNL_ARG_BIAS, state->bias}});
            port_store(&task->other, dnnl, out + n * out_image, strip_start(task, strip));
        }
    }
    dnnl_stream_wait(dnnl->stream);
}

static void forward(void *opaque, float *out, const float *in)
{
    struct state *state = opaque;
    convolve(state, &state->forward, out, in);
}

static void backward_data(void *opaque, float *din, const float *dout)
{
    struct state *state = opaque;
    convolve(state, &state->data, din, dout);
}

static void add(float *sum, const float *share, int64_t count)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        sum[i] += share[i];
    }
}

static void backward_weights(void *opaque, float *dweight, const float *in, const float *dout)
{
    struct state *state = opaque;
    const struct task *task = &state->gradient;
    const struct onednn *dnnl = &state->dnnl;
    int64_t in_image = task->in * task->read.height * task->read.width;
    int64_t out_image = task->out * task->other.height * task->other.width;
    int64_t floats = port_floats(&task->weights_desc);
    for (int64_t n = 0; n < state->spec.batch; n++) {
        for (int64_t strip = 0; strip < strip_count(task); strip++) {
            int first = n == 0 && strip == 0;
            port_load(&task->read, dnnl, in + n * in_image, read_start(task, strip), 0);
            port_load(&task->other, dnnl, dout + n * out_image, strip_start(task, strip),
                      strip * task->rows);
            onednn_run(dnnl, task->primitive, 3,
                       (dnnl_exec_arg_t[]){
                           {DNNL_ARG_SRC, task->strip_read},
                           {DNNL_ARG_DIFF_DST, task->strip_other},
                           {DNNL_ARG_DIFF_WEIGHTS, first ? state->scratch_memory : task->weights}});
            if (!first) {
                add(state->scratch, task->packed, floats);
            }
        }
    }
    onednn_point(task->plain, dweight);
    onednn_run(
        dnnl, task->reorder, 2,
        (dnnl_exec_arg_t[]){{DNNL_ARG_FROM, state->scratch_memory}, {DNNL_ARG_TO, task->plain}});
    dnnl_stream_wait(dnnl->stream);
}

const struct v2v_conv_backend v2v_conv_onednn = {.name = "oneDNN",
                                                 .create = create,
                                                 .destroy = destroy,
                                                 .set_weights = set_weights,
                                                 .forward = forward,
                                                 .backward_data = backward_data,
                                                 .backward_weights = backward_weights};

const struct v2v_conv_backend v2v_conv_bf16 = {.name = "oneDNN bf16",
                                               .create = create_bf16,
                                               .destroy = destroy,
                                               .set_weights = set_weights,
                                               .forward = forward,
                                               .backward_data = backward_data,
                                               .backward_weights = backward_weights};
