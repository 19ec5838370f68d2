#include "nn/head.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/op/winograd.h"

enum { STAGES = 2, TILE = V2V_WINOGRAD_ROWS };

struct v2v_head {
    struct v2v_align_conv *align; /* borrowed */
    const struct v2v_layer *layer[STAGES];
    struct v2v_winograd *stage[STAGES];
    int64_t height, width;
    int64_t rows;         /* of the output a strip */
    int64_t held[STAGES]; /* rows of the strip before each stage: with its neighbours' tiles */
};

static int64_t within(int64_t y, int64_t low, int64_t high)
{
    y = y > low ? y : low;
    return y < high ? y : high;
}

static void choose_rows(struct v2v_head *head, int64_t most_floats)
{
    int64_t before = head->layer[0]->in, between = head->layer[1]->in;
    int64_t spare = most_floats / head->width - 4 * TILE * before - 2 * TILE * between;
    int64_t most = within(spare / (before + between), 4 * TILE, head->height);
    int64_t strips = (head->height + most - 1) / most;
    int64_t rows = (head->height + strips - 1) / strips;
    head->rows = (rows + TILE - 1) / TILE * TILE;
    head->held[0] = within(head->rows + 4 * TILE, 0, head->height);
    head->held[1] = within(head->rows + 2 * TILE, 0, head->height);
}

static enum v2v_status create_stage(struct v2v_head *head, int i, struct v2v_workspace *workspace)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_layer *layer = head->layer[i];
    struct v2v_plane *plane = NULL;
    V2V_TRY(V2V_ALLOC(plane, "head.planes", layer->in));
    for (int64_t c = 0; c < layer->in; c++) {
        plane[c] = (struct v2v_plane){.offset = c * head->held[i] * head->width,
                                      .y1 = head->height,
                                      .x1 = head->width,
                                      .owner = c};
    }
    struct v2v_winograd_spec spec = {.in = layer->in,
                                     .out = layer->out,
                                     .height = head->height,
                                     .width = head->width,
                                     .out_rows = i == 0 ? head->held[1] : head->height,
                                     .plane = plane,
                                     .pitch = head->width,
                                     .slope = layer->slope,
                                     .workspace = workspace};
    V2V_TRY(v2v_winograd_create(&head->stage[i], &spec));
done:
    v2v_mem_free(plane);
    return rc;
}

static struct v2v_head laid_out(const struct v2v_head_spec *spec)
{
    struct v2v_head head = {
        .layer = {spec->first, spec->second}, .height = spec->height, .width = spec->width};
    choose_rows(&head, spec->most_floats);
    return head;
}

enum v2v_status v2v_head_create(struct v2v_head **head, const struct v2v_head_spec *spec,
                                struct v2v_align_conv *align, const struct v2v_padded *like,
                                struct v2v_workspace *workspace)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_head *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "head", 1));
    *self = laid_out(spec);
    self->align = align;
    V2V_TRY(v2v_align_conv_plan(align, like, self->held[0], 0));
    for (int i = 0; i < STAGES; i++) {
        V2V_TRY(create_stage(self, i, workspace));
    }
done:
    if (rc != V2V_OK) {
        v2v_head_destroy(&self);
    }
    *head = self;
    return rc;
}

void v2v_head_destroy(struct v2v_head **head)
{
    if (*head == NULL) {
        return;
    }
    for (int i = 0; i < STAGES; i++) {
        v2v_winograd_destroy(&(*head)->stage[i]);
    }
    v2v_mem_free(*head);
    *head = NULL;
}

static int64_t strip_floats(const struct v2v_head *head, int i)
{
    return (head->layer[i]->in * head->held[i] * head->width + 15) / 16 * 16;
}

int64_t v2v_head_floats(const struct v2v_head_spec *spec)
{
    struct v2v_head head = laid_out(spec);
    return strip_floats(&head, 0) + strip_floats(&head, 1);
}

void v2v_head_weights_changed(struct v2v_head *head, const struct v2v_parameters *parameters)
{
    for (int i = 0; i < STAGES; i++) {
        const struct v2v_layer *layer = head->layer[i];
        v2v_winograd_set_weights(
            head->stage[i], v2v_parameter(parameters->fields, parameters->weights, layer->weight),
            v2v_parameter(parameters->fields, parameters->weights, layer->bias));
    }
}

void v2v_head_forward(struct v2v_head *head, float *out, float *strips,
                      const struct v2v_padded *features)
{
    float *before = strips, *between = strips + strip_floats(head, 0);
    int64_t height = head->height, width = head->width;
    for (int64_t y = 0; y < height; y += head->rows) {
        int64_t end = within(y + head->rows, 0, height);
        int64_t y1 = within(y - TILE, 0, height), end1 = within(end + TILE, 0, height);
        int64_t y0 = within(y - 2 * TILE, 0, height), end0 = within(end + 2 * TILE, 0, height);
        v2v_align_conv_forward(head->align, before, features, y0, end0);
        v2v_winograd_forward_rows(head->stage[0], between, before, -y0 * width, y1, end1);
        v2v_winograd_forward_rows(head->stage[1], out + y * width, between, -y1 * width, y, end);
    }
}
