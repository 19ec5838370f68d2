/* The gradient of an implicit field by its table and by every array of its network: as it is, with
 * kinks of the layers and of the modulus everywhere; and with all numbers well above 0, when
 * no step cuts anything off and it is smooth. */
#include "gradient.h"
#include "small_draw.h"

#include "method/implicit_field.h"

#include <math.h>

enum { ARRAYS = 6, ARGUMENTS = ARRAYS + 1, WIDTH = 32 };

struct trial {
    struct v2v_implicit_field field;
    int64_t voxels;
    float *volume, *dvolume;
    int spoilt; /* argument whose gradient is multiplied by .. ; -1: none */
    float factor;
};

struct size {
    int64_t slices, height, columns;
    int64_t elements; /* tried by themselves; 0 where the table is filled up */
};

static const char *const names[ARGUMENTS] = {"W1", "b1", "W2", "b2", "w3", "b3", "table"};

/* Of the arrays in the weights, and the end. */
static void list_offsets(int64_t offset[ARRAYS + 1], const struct v2v_implicit_layout *at)
{
    const int64_t all[ARRAYS + 1] = {at->w1, at->b1, at->w2, at->b2, at->w3, at->b3, at->count};
    for (int i = 0; i <= ARRAYS; i++) {
        offset[i] = all[i];
    }
}

static void fill(float *x, int64_t count, uint64_t stream, double deviation, int is_smooth)
{
    for (int64_t i = 0; i < count; i++) {
        const double drawn = deviation * v2v_random_normal(5, stream, (uint64_t)i);
        x[i] = (float)(is_smooth ? fabs(drawn) + deviation : drawn);
    }
}

static int64_t numbers_of(const struct v2v_implicit_field *field)
{
    return field->rows.count * V2V_IMPLICIT_COORDINATES * field->run;
}

static void setup(struct trial *t, int is_smooth, const struct size *size)
{
    *t = (struct trial){
        .voxels = size->slices * size->height * size->columns, .spoilt = -1, .factor = 1.0f};
    struct v2v_implicit_field *field = &t->field;
    assert_ok(
        v2v_implicit_field_init(field, WIDTH, size->slices, size->height, size->columns, NULL));
    fill(field->table, numbers_of(field), 1, 1.0, is_smooth);
    fill(field->weights, field->at.count, 2, 0.3, is_smooth);
    t->volume = small_draw(t->voxels, 3, 1.0);
    t->dvolume = small_draw(t->voxels, 4, 1.0);
}

static void teardown(struct trial *t)
{
    v2v_implicit_field_fini(&t->field);
    v2v_mem_free(t->volume);
    v2v_mem_free(t->dvolume);
    assert_int_equal(v2v_mem_held(), 0);
}

static void forward(void *self, double *out)
{
    struct trial *t = self;
    v2v_implicit_field_forward(&t->field, t->volume);
    for (int64_t i = 0; i < t->voxels; i++) {
        out[i] = (double)t->volume[i];
    }
}

static void backward(void *self, const double *dout)
{
    struct trial *t = self;
    struct v2v_implicit_field *field = &t->field;
    int64_t offset[ARRAYS + 1];
    v2v_implicit_field_forward(field, t->volume);
    for (int64_t i = 0; i < t->voxels; i++) {
        t->dvolume[i] = (float)dout[i];
    }
    v2v_implicit_field_backward(field, t->dvolume);
    list_offsets(offset, &field->at);
    for (int64_t i = 0; i < numbers_of(field) && t->spoilt == ARRAYS; i++) {
        field->dtable[i] *= t->factor;
    }
    for (int i = 0; i < ARRAYS; i++) {
        for (int64_t k = offset[i]; k < offset[i + 1] && t->spoilt == i; k++) {
            field->dweights[k] *= t->factor;
        }
    }
}

static const char *fault_of(struct trial *t, int is_smooth, int64_t elements)
{
    const struct v2v_implicit_field *field = &t->field;
    /* of an output and back: 2, 32, 32 products; of a weight, as many as there are voxels */
    const double terms = 2.0 + 2.0 * WIDTH;
    struct test_argument argument[ARGUMENTS];
    int64_t offset[ARRAYS + 1];
    list_offsets(offset, &field->at);
    for (int i = 0; i < ARRAYS; i++) {
        argument[i] = (struct test_argument){.name = names[i],
                                             .x = field->weights + offset[i],
                                             .gradient = field->dweights + offset[i],
                                             .count = offset[i + 1] - offset[i]};
    }
    argument[ARRAYS] = (struct test_argument){.name = names[ARRAYS],
                                              .x = field->table,
                                              .gradient = field->dtable,
                                              .count = numbers_of(field)};
    return test_gradient_fault(
        &(struct test_function){.name = "implicit field",
                                .argument = argument,
                                .arguments = ARGUMENTS,
                                .outs = t->voxels,
                                .self = t,
                                .forward = forward,
                                .backward = backward,
                                .step = 0x1p-6,
                                .rounding = test_rounding(terms),
                                .backward_rounding = test_rounding(terms + (double)t->voxels),
                                .elements = elements,
                                .sees = is_smooth ? 0.02 : 0.4,
                                .kinks = is_smooth ? TEST_SMOOTH : TEST_KINKS});
}

/* Rows of whole panels; of fewer voxels than a panel; and of more parts than one. */
static const struct size sizes[] = {{4, 6, 8, 1}, {3, 5, 7, 0}, {5, 3, 64, 1}};

static void the_field_has_its_gradient(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        for (int is_smooth = 0; is_smooth < 2; is_smooth++) {
            struct trial t;
            setup(&t, is_smooth, &sizes[i]);
            const char *wrong = fault_of(&t, is_smooth, sizes[i].elements);
            if (wrong != NULL) {
                fail_msg("size %d, smooth %d: %s", (int)i, is_smooth, wrong);
            }
            teardown(&t);
        }
    }
}

static void a_wrong_gradient_fails(void **state)
{
    (void)state;
    for (int is_smooth = 0; is_smooth < 2; is_smooth++) {
        struct trial t;
        setup(&t, is_smooth, &sizes[0]);
        t.factor = is_smooth ? 1.05f : -1.0f;
        for (t.spoilt = 0; t.spoilt < ARGUMENTS; t.spoilt++) {
            if (fault_of(&t, is_smooth, 1) == NULL) {
                fail_msg("%s times %g: passes", names[t.spoilt], (double)t.factor);
            }
        }
        teardown(&t);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_field_has_its_gradient),
        cmocka_unit_test(a_wrong_gradient_fails),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
