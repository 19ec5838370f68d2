/* Ranks that share the volumes get the loss and the gradients of one rank, to the last bit. */
#include "held_out.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <omp.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 6, HEIGHT = 45, WIDTH = 32, KERNEL = 7, OUTPUTS = 2 };
enum { PIXELS = HEIGHT * WIDTH, VOXELS = SLICES * PIXELS };

struct judged {
    struct v2v_psf_file psf;
    struct v2v_config config;
    float views[VIEWS * PIXELS], volume[OUTPUTS][VOXELS];
    size_t held; /* bytes before */
};

/* What one rank finds, and the rows of another. */
struct found {
    double terms[V2V_LOSS_TERMS];
    float dvolume[OUTPUTS][VOXELS];
};

static void fill(float *x, int64_t count, uint64_t stream, double mean)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(mean + 0.3 * v2v_random_normal(29, stream, (uint64_t)i));
    }
}

static void setup(struct judged *j)
{
    memset(j, 0, sizeof *j);
    j->held = v2v_mem_held();
    v2v_config_defaults(&j->config);
    j->psf =
        (struct v2v_psf_file){.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL};
    assert_ok(V2V_ALLOC(j->psf.data, "test", VIEWS * SLICES * KERNEL * KERNEL));
    for (int64_t i = 0; i < VIEWS * SLICES * KERNEL * KERNEL; i++) {
        j->psf.data[i] = (float)v2v_random_uniform(29, 0, (uint64_t)i);
    }
    v2v_psf_normalize_views(&j->psf);
    fill(j->views, VIEWS * PIXELS, 1, 0.5);
    fill(&j->volume[0][0], OUTPUTS * VOXELS, 2, 0.2);
}

static void teardown(struct judged *j)
{
    v2v_psf_file_fini(&j->psf);
    assert_int_equal(v2v_mem_held(), j->held);
}

/* rows [z,rows,x] of a volume. */
static void cut(float *to, const float *volume, struct v2v_part rows)
{
    for (int64_t z = 0; z < SLICES; z++) {
        memcpy(to + z * rows.count * WIDTH, volume + z * PIXELS + rows.first * WIDTH,
               (size_t)(rows.count * WIDTH) * sizeof *to);
    }
}

/* Judge the volumes on the ranks of comm, each with its rows; NULL: those of the projector. */
static struct v2v_part judge(struct found *found, const struct judged *j, int outputs,
                             enum v2v_split split, const struct v2v_part *rows,
                             const struct v2v_comm *comm)
{
    static float volume[OUTPUTS][VOXELS];
    const float *const volumes[OUTPUTS] = {volume[0], volume[1]};
    float *const dvolumes[OUTPUTS] = {found->dvolume[0], found->dvolume[1]};
    struct v2v_projector *projector = NULL;
    struct v2v_loss *loss = NULL;
    assert_ok(v2v_projector_create(&projector, &j->psf, HEIGHT, WIDTH, split, comm));
    struct v2v_part own = rows != NULL ? *rows : v2v_projector_share(projector).rows;
    struct v2v_loss_setup setup = {.settings = &j->config.loss,
                                   .psf = &j->psf,
                                   .reduce = V2V_REDUCE_MEAN,
                                   .height = HEIGHT,
                                   .width = WIDTH,
                                   .window = {3, 40, 2, 29},
                                   .projector = projector,
                                   .comm = comm};
    test_hold_out_halves(&setup, VIEWS);
    setup.outputs = outputs;
    for (int o = 0; o < OUTPUTS; o++) {
        cut(volume[o], j->volume[o], own);
    }
    memset(found, 0, sizeof *found);
    assert_ok(v2v_loss_create(&loss, &setup));
    if (rows != NULL) {
        assert_ok(v2v_loss_hold(loss, own));
    }
    v2v_loss_evaluate(loss, found->terms, 3, dvolumes, volumes, j->views);
    v2v_loss_destroy(&loss);
    v2v_projector_destroy(&projector);
    return own;
}

static void assert_same_bits(const struct found *share, struct v2v_part own,
                             const struct found *whole)
{
    static float rows[VOXELS];
    for (int t = 0; t < V2V_LOSS_TERMS; t++) {
        print_message("%s %.17g\n", v2v_loss_name(t), share->terms[t]);
        assert_true(share->terms[t] == whole->terms[t]);
    }
    for (int o = 0; o < OUTPUTS; o++) {
        cut(rows, whole->dvolume[o], own);
        assert_memory_equal(share->dvolume[o], rows,
                            (size_t)(SLICES * own.count * WIDTH) * sizeof *rows);
    }
}

/* Nothing for the first of several ranks, all that is left over for the last one. */
static struct v2v_part uneven_rows(void)
{
    const int64_t size = v2v_comm_size(test_world()), rank = v2v_comm_rank(test_world());
    const int64_t first = size > 1 ? 16 * (rank > 0 ? rank - 1 : 0) : 0;
    const int64_t count = rank == size - 1 ? HEIGHT - first : rank == 0 ? 0 : 16;
    return (struct v2v_part){first < HEIGHT ? first : HEIGHT, count};
}

static void ranks_get_the_bits_of_one_rank(void **state)
{
    static struct judged j;
    static struct found whole, share;
    const struct v2v_part uneven = uneven_rows();
    (void)state;
    setup(&j);
    for (int profile = 0; profile < V2V_LOSS_PROFILES; profile++) {
        for (int outputs = 1; outputs <= OUTPUTS; outputs++) {
            j.config.loss.profile = profile;
            (void)judge(&whole, &j, outputs, V2V_SPLIT_SLABS, NULL, NULL);
            struct v2v_part own = judge(&share, &j, outputs, V2V_SPLIT_SLABS, NULL, test_world());
            assert_same_bits(&share, own, &whole);
            own = judge(&share, &j, outputs, V2V_SPLIT_SLABS, &uneven, test_world());
            assert_same_bits(&share, own, &whole);
        }
    }
    teardown(&j);
}

/* A view that errs by 1e-7 has phases that err by 2e-6 in the mean square (tests/unit/loss), there
 * and back through the adjoint twice that. */
static void a_projector_of_slices_does_too_but_for_its_rounding(void **state)
{
    static struct judged j;
    static struct found whole, share;
    static float rows[VOXELS];
    const struct v2v_part uneven = uneven_rows();
    (void)state;
    setup(&j);
    (void)judge(&whole, &j, OUTPUTS, V2V_SPLIT_SLABS, NULL, NULL);
    (void)judge(&share, &j, OUTPUTS, V2V_SPLIT_SLICES, &uneven, test_world());
    for (int o = 0; o < OUTPUTS; o++) {
        cut(rows, whole.dvolume[o], uneven);
        assert_true(uneven.count == 0 || test_relative_l2(share.dvolume[o], rows,
                                                          SLICES * uneven.count * WIDTH) <= 4e-6);
    }
    assert_true(share.terms[V2V_LOSS_POS] == whole.terms[V2V_LOSS_POS]);
    teardown(&j);
}

static void threads_get_the_bits_of_one_thread(void **state)
{
    static struct judged j;
    static struct found one, three;
    (void)state;
    setup(&j);
    (void)judge(&one, &j, OUTPUTS, V2V_SPLIT_SLABS, NULL, NULL);
    omp_set_num_threads(3);
    (void)judge(&three, &j, OUTPUTS, V2V_SPLIT_SLABS, NULL, NULL);
    omp_set_num_threads(1);
    assert_same_bits(&three, (struct v2v_part){0, HEIGHT}, &one);
    teardown(&j);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ranks_get_the_bits_of_one_rank),
        cmocka_unit_test(a_projector_of_slices_does_too_but_for_its_rounding),
        cmocka_unit_test(threads_get_the_bits_of_one_thread),
    };
    return test_mpi_main(tests, argc, argv);
}
