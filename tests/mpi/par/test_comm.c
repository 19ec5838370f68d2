#include "support.h"

#include "v2v3d/base/memory.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* Must stay above the piece of one MPI call in reduce.c (2^24), and no multiple of it. */
enum { LARGE = (1 << 24) + 12345 };

static int rank_of_world(void)
{
    return v2v_comm_rank(test_world());
}

static int64_t size_of_world(void)
{
    return v2v_comm_size(test_world());
}

static enum v2v_status fail_on(int rank, enum v2v_status code)
{
    return rank_of_world() == rank ? V2V_FAIL(code, "view %d is torn", rank) : V2V_OK;
}

static enum v2v_status load_my_views(float *views, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        views[i] = 1.0f;
    }
    return views[0] == 1.0f ? V2V_OK : V2V_FAIL(V2V_E_INPUT, "view 0 is torn");
}

/** The example of par/comm.h. */
static enum v2v_status header_example(const struct v2v_comm *comm, float *views, int64_t count)
{
    enum v2v_status rc = load_my_views(views, count); // Local: may fail, may not leave
    V2V_TRY(v2v_par_agree(comm, rc));                 // Collective: all hold the same code now
    v2v_par_sum_f32(comm, views, count);              // Collective: nobody is missing
done:
    return rc;
}

static void header_example_works(void **state)
{
    (void)state;
    float views[3] = {0};
    assert_ok(header_example(test_world(), views, 3));
    assert_true(views[2] == (float)size_of_world());
}

static void agree_is_ok_when_all_ranks_are(void **state)
{
    (void)state;
    assert_int_equal(v2v_par_agree(test_world(), V2V_OK), V2V_OK);
}

static void agree_gives_every_rank_the_failing_ranks_message(void **state)
{
    (void)state;
    char expected[64];
    int failing = (int)size_of_world() / 2;
    snprintf(expected, sizeof expected, "view %d is torn", failing);
    v2v_status_set_message("an older failure", "nowhere:1");
    assert_int_equal(v2v_par_agree(test_world(), fail_on(failing, V2V_E_INPUT)), V2V_E_INPUT);
    const char *found = strstr(v2v_status_message(), expected);
    assert_non_null(found);
    assert_string_equal(found, expected);
    assert_non_null(strstr(v2v_status_place(), "test_comm.c:"));
    if (size_of_world() > 1) {
        char prefix[32];
        snprintf(prefix, sizeof prefix, "rank %d: ", failing);
        assert_int_equal(strncmp(v2v_status_message(), prefix, strlen(prefix)), 0);
    }
}

static void agree_takes_the_worst_code_of_the_lowest_rank_that_holds_it(void **state)
{
    (void)state;
    int last = (int)size_of_world() - 1;
    enum v2v_status mine = rank_of_world() == last ? V2V_FAIL(V2V_E_IO, "worst on %d", last)
                                                   : V2V_FAIL(V2V_E_CONFIG, "mild");
    assert_int_equal(v2v_par_agree(test_world(), mine), V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), "worst on"));
    mine = V2V_FAIL(V2V_E_IO, "from %d", rank_of_world());
    assert_int_equal(v2v_par_agree(test_world(), mine), V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), "from 0"));
}

static void agreeing_twice_names_the_rank_once(void **state)
{
    (void)state;
    int last = (int)size_of_world() - 1;
    enum v2v_status rc = v2v_par_agree(test_world(), fail_on(last, V2V_E_INPUT));
    assert_int_equal(v2v_par_agree(test_world(), rc), V2V_E_INPUT);
    const char *first = strstr(v2v_status_message(), "rank ");
    assert_true(size_of_world() == 1 || (first != NULL && strstr(first + 1, "rank ") == NULL));
}

/** x[i] = rank + 1 + i % 7 summed over n ranks is n (n + 1) / 2 + n (i % 7): whole numbers below
 *  2^24, so that the float sum is exact in any order. */
static void check_sum_f32(int64_t count)
{
    const int64_t n = size_of_world();
    float *x = NULL;
    assert_ok(V2V_ALLOC(x, "test", count));
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(rank_of_world() + 1 + i % 7);
    }
    v2v_par_sum_f32(test_world(), x, count);
    int64_t wrong = 0;
    for (int64_t i = 0; i < count; i++) {
        wrong += x[i] != (float)(n * (n + 1) / 2 + n * (i % 7));
    }
    v2v_mem_free(x);
    assert_int_equal(wrong, 0);
}

static void sum_f32_is_exact_for_no_one_and_more_than_one_piece_of_elements(void **state)
{
    (void)state;
    check_sum_f32(0);
    check_sum_f32(1);
    check_sum_f32(1000);
    check_sum_f32(LARGE);
}

/* Magnitudes over seven decades: two orders of a sum differ in most elements. */
static float contribution(int64_t item, int64_t i)
{
    return (float)((i * 7919 + item * 104729) % 10007) * (item % 2 == 0 ? 1.0f : 1e-7f);
}

static void ordered_sum_has_the_bits_of_the_sum_on_one_rank(void **state)
{
    (void)state;
    enum { COUNT = 2 * V2V_PAR_SCRATCH + 77 };
    float *x = NULL, *scratch = NULL, *alone = NULL;
    assert_ok(V2V_ALLOC(x, "test", COUNT));
    assert_ok(V2V_ALLOC(alone, "test", COUNT));
    assert_ok(V2V_ALLOC(scratch, "test", V2V_PAR_SCRATCH));
    for (int64_t i = 0; i < COUNT; i++) {
        x[i] = contribution(rank_of_world(), i);
        for (int item = 0; item < size_of_world(); item++) {
            alone[i] += contribution(item, i);
        }
    }
    v2v_par_sum_ordered_f32(test_world(), x, COUNT, scratch);
    assert_memory_equal(x, alone, COUNT * sizeof *x);
    float *memory[] = {x, scratch, alone};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
}

static void sums_and_maxima_of_the_other_types_are_exact(void **state)
{
    (void)state;
    const int64_t n = size_of_world(), r = rank_of_world();
    double d[2] = {(double)r, 0.25};
    int64_t i[2] = {r, (int64_t)1 << 60};
    v2v_par_sum_f64(test_world(), d, 2);
    v2v_par_sum_i64(test_world(), i, 1);
    assert_true(d[0] == (double)(n * (n - 1) / 2) && d[1] == 0.25 * (double)n);
    assert_int_equal(i[0], n * (n - 1) / 2);
    double dm[2] = {(double)r, -(double)r};
    int64_t im[2] = {-r, ((int64_t)1 << 60) + r};
    v2v_par_max_f64(test_world(), dm, 2);
    v2v_par_max_i64(test_world(), im, 2);
    assert_true(dm[0] == (double)(n - 1) && dm[1] == 0.0);
    assert_int_equal(im[0], 0);
    assert_int_equal(im[1], ((int64_t)1 << 60) + n - 1);
}

static void check_broadcast(int64_t bytes, int root)
{
    unsigned char *data = NULL;
    assert_ok(V2V_ALLOC(data, "test", bytes));
    for (int64_t i = 0; rank_of_world() == root && i < bytes; i++) {
        data[i] = (unsigned char)(i % 251 + 1);
    }
    v2v_par_broadcast(test_world(), data, bytes, root);
    int64_t wrong = 0;
    for (int64_t i = 0; i < bytes; i++) {
        wrong += data[i] != (unsigned char)(i % 251 + 1);
    }
    v2v_mem_free(data);
    assert_int_equal(wrong, 0);
}

static void broadcast_brings_the_roots_bytes_to_all(void **state)
{
    (void)state;
    int last = (int)size_of_world() - 1;
    check_broadcast(0, last);
    check_broadcast(1, 0);
    check_broadcast(1000, last);
    check_broadcast(LARGE, last);
}

static void allgather_places_uneven_parts(void **state)
{
    (void)state;
    enum { GAP = 3, ITEMS = 10, MOST = 64 };
    int64_t count[MOST], offset[MOST];
    float mine[ITEMS], out[ITEMS + MOST * GAP];
    const int n = (int)size_of_world(), rank = rank_of_world();
    assert_true(n <= MOST);
    for (int in_place = 0; in_place < 2; in_place++) {
        memset(out, 0, sizeof out);
        for (int r = 0; r < n; r++) {
            /* Rank 1 has nothing; parts lie apart. */
            struct v2v_part part = v2v_par_part(ITEMS, n, r);
            count[r] = r == 1 ? 0 : part.count;
            offset[r] = part.first + (int64_t)r * GAP;
        }
        float *source = in_place ? out + offset[rank] : mine;
        for (int64_t i = 0; i < count[rank]; i++) {
            source[i] = (float)(100 * (rank + 1) + i);
        }
        v2v_par_allgather_f32(test_world(), out, source, count, offset);
        for (int r = 0; r < n; r++) {
            for (int64_t i = 0; i < count[r]; i++) {
                assert_true(out[offset[r] + i] == (float)(100 * (r + 1) + i));
            }
            for (int64_t g = 0; g < GAP; g++) {
                assert_true(out[offset[r] + count[r] + g] == 0.0f);
            }
        }
    }
}

static void exchange_swaps_the_neighbours_numbers(void **state)
{
    (void)state;
    const int n = (int)size_of_world(), rank = rank_of_world();
    int other = rank % 2 == 0 ? rank + 1 : rank - 1;
    other = other < n ? other : rank; /* the left-over rank exchanges with itself */
    float *sent = NULL, *received = NULL;
    assert_ok(V2V_ALLOC(sent, "test", LARGE));
    assert_ok(V2V_ALLOC(received, "test", LARGE));
    for (int64_t i = 0; i < LARGE; i++) {
        sent[i] = (float)(rank * 1000 + i % 999);
    }
    v2v_par_exchange_f32(test_world(), received, sent, LARGE, other);
    v2v_par_exchange_f32(test_world(), received, sent, 0, other);
    int64_t wrong = 0;
    for (int64_t i = 0; i < LARGE; i++) {
        wrong += received[i] != (float)(other * 1000 + i % 999);
    }
    v2v_mem_free(sent);
    v2v_mem_free(received);
    assert_int_equal(wrong, 0);
}

static void split_orders_ranks_by_key_and_names_world_ranks(void **state)
{
    (void)state;
    struct v2v_comm *half = NULL;
    const int n = (int)size_of_world(), rank = rank_of_world();
    int colour = rank % 2;
    assert_ok(v2v_comm_split(&half, test_world(), colour, -rank));
    int expected_size = (n + 1 - colour) / 2;
    assert_int_equal(v2v_comm_size(half), expected_size);
    assert_int_equal(v2v_comm_rank(half), expected_size - 1 - rank / 2);
    int64_t ranks = rank;
    v2v_par_max_i64(half, &ranks, 1);
    assert_int_equal(ranks, 2 * (expected_size - 1) + colour);
    /* Inside the half the message names the world's rank: the failing one is the half's rank 0. */
    enum v2v_status rc =
        v2v_comm_rank(half) == 0 ? V2V_FAIL(V2V_E_IO, "half fails") : (enum v2v_status)V2V_OK;
    assert_int_equal(v2v_par_agree(half, rc), V2V_E_IO);
    if (expected_size > 1) {
        char expected[64];
        snprintf(expected, sizeof expected, "rank %d: half fails", (int)ranks);
        assert_string_equal(v2v_status_message(), expected);
    }
    v2v_par_barrier(half);
    v2v_comm_destroy(&half);
    assert_null(half);
}

/* All tests run on one host. */
static void split_host_takes_ranks_in_their_order(void **state)
{
    (void)state;
    const int n = (int)size_of_world(), rank = rank_of_world();
    for (int most = 1; most <= n + 1; most++) {
        struct v2v_comm *group = NULL;
        const int processors = (int)sysconf(_SC_NPROCESSORS_ONLN);
        const int together = most < processors ? most : processors;
        const int before = rank / together * together;
        assert_ok(v2v_comm_split_host(&group, test_world(), most));
        assert_int_equal(v2v_comm_size(group), n - before < together ? n - before : together);
        assert_int_equal(v2v_comm_rank(group), rank - before);
        int64_t ranks = -rank;
        v2v_par_max_i64(group, &ranks, 1);
        assert_int_equal(-ranks, before);
        v2v_comm_destroy(&group);
    }
}

static void null_communicator_is_this_rank_alone(void **state)
{
    (void)state;
    struct v2v_comm *comm = NULL;
    double x = 3.0;
    float sent = 2.0f, received = 0.0f, out[3] = {0};
    int64_t count = 1, offset = 2;
    assert_int_equal(v2v_comm_rank(NULL), 0);
    assert_int_equal(v2v_comm_size(NULL), 1);
    assert_ok(v2v_comm_split(&comm, NULL, 5, 5));
    assert_null(comm);
    assert_ok(v2v_comm_split_host(&comm, NULL, 1));
    assert_null(comm);
    assert_int_equal(v2v_par_agree(NULL, V2V_E_BUSY), V2V_E_BUSY);
    v2v_par_sum_f64(NULL, &x, 1);
    v2v_par_max_f64(NULL, &x, 1);
    v2v_par_broadcast(NULL, &x, sizeof x, 0);
    v2v_par_barrier(NULL);
    v2v_par_exchange_f32(NULL, &received, &sent, 1, 0);
    v2v_par_allgather_f32(NULL, out, &sent, &count, &offset);
    assert_true(x == 3.0 && received == 2.0f && out[2] == 2.0f && out[0] == 0.0f);
    v2v_comm_destroy(&comm);
}

static void folder_is_the_same_on_all_ranks_and_fresh(void **state)
{
    (void)state;
    char first[512], same[512];
    snprintf(first, sizeof first, "%s", test_folder(test_world()));
    memcpy(same, first, sizeof same);
    v2v_par_broadcast(test_world(), same, sizeof same, 0);
    assert_string_equal(first, same);
    assert_string_not_equal(first, test_folder(test_world()));
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(header_example_works),
        cmocka_unit_test(agree_is_ok_when_all_ranks_are),
        cmocka_unit_test(agree_gives_every_rank_the_failing_ranks_message),
        cmocka_unit_test(agree_takes_the_worst_code_of_the_lowest_rank_that_holds_it),
        cmocka_unit_test(agreeing_twice_names_the_rank_once),
        cmocka_unit_test(sum_f32_is_exact_for_no_one_and_more_than_one_piece_of_elements),
        cmocka_unit_test(ordered_sum_has_the_bits_of_the_sum_on_one_rank),
        cmocka_unit_test(sums_and_maxima_of_the_other_types_are_exact),
        cmocka_unit_test(broadcast_brings_the_roots_bytes_to_all),
        cmocka_unit_test(allgather_places_uneven_parts),
        cmocka_unit_test(exchange_swaps_the_neighbours_numbers),
        cmocka_unit_test(split_orders_ranks_by_key_and_names_world_ranks),
        cmocka_unit_test(split_host_takes_ranks_in_their_order),
        cmocka_unit_test(null_communicator_is_this_rank_alone),
        cmocka_unit_test(folder_is_the_same_on_all_ranks_and_fresh),
    };
    return test_mpi_main(tests, argc, argv);
}
