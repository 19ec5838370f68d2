/* Packing buffers by their lifetimes. */
#include "support.h"

#include "v2v3d/base/random.h"
#include "v2v3d/tensor/slots.h"

static int overlap(const struct v2v_slot *a, const struct v2v_slot *b)
{
    int together = a->first <= b->last && b->first <= a->last;
    return together && a->floats > 0 && b->floats > 0 && a->offset < b->offset + b->floats &&
           b->offset < a->offset + a->floats;
}

static void slots_needed_together_never_overlap(void **state)
{
    (void)state;
    enum { COUNT = 40, STEPS = 12, ROUNDS = 50 };
    struct v2v_slot slots[COUNT];
    float *memory[COUNT], arena[1];
    for (uint64_t round = 0; round < ROUNDS; round++) {
        int64_t sum = 0, most = 0;
        for (int i = 0; i < COUNT; i++) {
            int first = (int)v2v_random_below(1, round, (uint64_t)i, STEPS);
            int length = (int)v2v_random_below(2, round, (uint64_t)i, 4);
            int64_t floats = (int64_t)v2v_random_below(3, round, (uint64_t)i, 5000);
            slots[i] = (struct v2v_slot){&memory[i], floats, first, first + length, 0};
            sum += floats + 15;
        }
        int64_t total = v2v_slots_pack(slots, COUNT);
        for (int i = 0; i < COUNT; i++) {
            assert_int_equal(slots[i].offset % 16, 0);
            assert_true(slots[i].offset >= 0 && slots[i].offset + slots[i].floats <= total);
            for (int j = 0; j < i; j++) {
                assert_false(overlap(&slots[i], &slots[j]));
            }
        }
        for (int step = 0; step < STEPS + 4; step++) {
            int64_t needed = 0;
            for (int i = 0; i < COUNT; i++) {
                int here = slots[i].first <= step && step <= slots[i].last;
                needed += here ? slots[i].floats : 0;
            }
            most = needed > most ? needed : most;
        }
        assert_true(total >= most && total < sum);
        v2v_slots_place(slots, COUNT, arena);
        assert_ptr_equal(memory[3], arena + slots[3].offset);
    }
}

static void a_chain_of_equal_buffers_takes_two(void **state)
{
    (void)state;
    enum { COUNT = 9 };
    struct v2v_slot slots[COUNT];
    float *memory[COUNT];
    for (int i = 0; i < COUNT; i++) {
        slots[i] = (struct v2v_slot){&memory[i], 100, i, i + 1, 0};
    }
    assert_int_equal(v2v_slots_pack(slots, COUNT), 2 * 112);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slots_needed_together_never_overlap),
        cmocka_unit_test(a_chain_of_equal_buffers_takes_two),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
