#include "v2v3d/tensor/slots.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/status.h"

#include <stddef.h>

enum { ALIGNMENT = 16, UNPLACED = -1 };

static int64_t rounded(int64_t floats)
{
    return v2v_round_up(floats, ALIGNMENT);
}

static int live_together(const struct v2v_slot *a, const struct v2v_slot *b)
{
    return a->first <= b->last && b->first <= a->last;
}

/* The largest slot that has no place yet, NULL: all have one. */
static struct v2v_slot *largest_unplaced(struct v2v_slot *slots, int64_t count)
{
    struct v2v_slot *largest = NULL;
    for (int64_t i = 0; i < count; i++) {
        if (slots[i].offset == UNPLACED && (largest == NULL || slots[i].floats > largest->floats)) {
            largest = &slots[i];
        }
    }
    return largest;
}

/* The end of a placed slot that is in the way of `slot` at `offset`; `offset` itself: none is. */
static int64_t end_of_obstacle(const struct v2v_slot *slots, int64_t count,
                               const struct v2v_slot *slot, int64_t offset)
{
    for (int64_t i = 0; i < count; i++) {
        const struct v2v_slot *other = &slots[i];
        int64_t end = other->offset + rounded(other->floats);
        if (other->offset != UNPLACED && live_together(slot, other) && offset < end &&
            other->offset < offset + rounded(slot->floats)) {
            return end;
        }
    }
    return offset;
}

int64_t v2v_slots_pack(struct v2v_slot *slots, int64_t count)
{
    int64_t total = 0;
    struct v2v_slot *slot;
    for (int64_t i = 0; i < count; i++) {
        V2V_ASSERT(slots[i].floats >= 0 && slots[i].first <= slots[i].last);
        slots[i].offset = UNPLACED;
    }
    while ((slot = largest_unplaced(slots, count)) != NULL) {
        int64_t offset = 0, next;
        while ((next = end_of_obstacle(slots, count, slot, offset)) != offset) {
            offset = next;
        }
        slot->offset = offset;
        total = offset + rounded(slot->floats) > total ? offset + rounded(slot->floats) : total;
    }
    return total;
}

void v2v_slots_place(const struct v2v_slot *slots, int64_t count, float *arena)
{
    for (int64_t i = 0; i < count; i++) {
        *slots[i].memory = arena + slots[i].offset;
    }
}
