/** Moving rows of an image between the caller's plain float32 [c,y,x] and a strip in oneDNN's own
 *  layout and data type.
 *
 *  A convolution runs over strips of rows: the copies in oneDNN's layout then take some MB whatever
 *  the frame's size, and stay in the cache between the reorder and the convolution. Rows outside
 * the image are zeros of the strip, so that every strip is the same primitive without padding in y.
 */
#ifndef OP_ONEDNN_PORT_H
#define OP_ONEDNN_PORT_H

#include "v2v3d/base/status.h"
#include <oneapi/dnnl/dnnl.h>
#include <stdint.h>

struct onednn {
    dnnl_engine_t engine;
    dnnl_stream_t stream;
};

/** V2V_OK, or a failure that names what was asked of oneDNN. */
enum v2v_status onednn_check(dnnl_status_t status, const char *what) V2V_MUST_CHECK;

/** Run a primitive that was made to fit its arguments: a refusal is a bug. */
void onednn_run(const struct onednn *dnnl, dnnl_primitive_t primitive, int count,
                const dnnl_exec_arg_t *args);

/** Let a memory object lie at `data`. oneDNN knows no read-only memory: what is an input stays
 *  unwritten by the primitive's contract. */
void onednn_point(dnnl_memory_t memory, const float *data);

/** Create a primitive and drop its description. */
enum v2v_status onednn_primitive(dnnl_primitive_t *primitive,
                                 dnnl_primitive_desc_t description) V2V_MUST_CHECK;

/** Rows that reach into the image at one place of the strip. */
struct window {
    int64_t offset, rows;
    dnnl_primitive_t reorder;
    dnnl_memory_t plain, strip;
};

enum port_direction { PORT_LOAD, PORT_STORE };

/** At most: the top strip, the inner ones, the bottom one. */
enum { PORT_WINDOWS = 3 };

struct port {
    enum port_direction direction;
    int64_t channels, height, width; /**< of the plain image */
    dnnl_memory_desc_t desc;         /**< of the strip [1,c,rows,x] */
    int64_t rows;
    int step;       /**< strip pixels from one image pixel to the next; 2: zeros in between */
    float *memory;  /**< the strip, of any type; borrowed */
    int64_t floats; /**< of the strip, padding included */
    struct window windows[PORT_WINDOWS];
    int count;
};

/** Make the reorder for the strip whose row 0 is image row `first` (in strip pixels, may be
 *  negative) without the rows before `from`; nothing new when a like one is there. */
enum v2v_status port_prepare(struct port *port, const struct onednn *dnnl, int64_t first,
                             int64_t from) V2V_MUST_CHECK;

/** Bytes of a strip of this description in whole floats. */
int64_t port_floats(const dnnl_memory_desc_t *desc);

/** Copy the rows of port_prepare's window; the rest of a loaded strip becomes zero. */
void port_load(const struct port *port, const struct onednn *dnnl, const float *image,
               int64_t first, int64_t from);
void port_store(const struct port *port, const struct onednn *dnnl, float *image, int64_t first);

void port_fini(struct port *port);

#endif
