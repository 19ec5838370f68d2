#include "v2v3d/base/memory.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
#define GUARD(address, bytes) __asan_poison_memory_region((address), (bytes))
#define UNGUARD(address, bytes) __asan_unpoison_memory_region((address), (bytes))
#else
#define GUARD(address, bytes) ((void)(address), (void)(bytes))
#define UNGUARD(address, bytes) ((void)(address), (void)(bytes))
#endif

enum { MOST_LABELS = 256 };

/* "v2v3dmem": tells our memory from anything else that is handed to v2v_mem_free. */
static const uint64_t magic_taken = 0x763276336d656d21;

/** Lies right before the caller's memory. */
struct header {
    void *raw; /**< what calloc or mmap gave */
    size_t bytes;
    uint64_t magic;
    int64_t label;
};

struct label {
    const char *name;
    size_t held;
    size_t peak;
};

/* Everything that is held by this process, by label. The last label gathers what has no place. */
static struct {
    pthread_mutex_t lock;
    struct label label[MOST_LABELS];
    int64_t labels;
    size_t held;
    size_t peak;
    size_t limit;
} account = {.lock = PTHREAD_MUTEX_INITIALIZER};

static int64_t label_index(const char *name)
{
    for (int64_t i = 0; i < account.labels; i++) {
        if (account.label[i].name == name || strcmp(account.label[i].name, name) == 0) {
            return i;
        }
    }
    if (account.labels == MOST_LABELS - 1) {
        name = "(other labels)";
    }
    if (account.labels < MOST_LABELS) {
        account.label[account.labels++].name = name;
    }
    return account.labels - 1;
}

/** Count `bytes` in; -1 when that would pass the limit. */
static int64_t account_take(const char *name, size_t bytes)
{
    int64_t index = -1;
    pthread_mutex_lock(&account.lock);
    if (account.limit == 0 || (bytes <= account.limit && account.held <= account.limit - bytes)) {
        index = label_index(name);
        struct label *label = &account.label[index];
        label->held += bytes;
        account.held += bytes;
        label->peak = label->held > label->peak ? label->held : label->peak;
        account.peak = account.held > account.peak ? account.held : account.peak;
    }
    pthread_mutex_unlock(&account.lock);
    return index;
}

static void account_give(int64_t index, size_t bytes)
{
    pthread_mutex_lock(&account.lock);
    account.label[index].held -= bytes;
    account.held -= bytes;
    pthread_mutex_unlock(&account.lock);
}

/* Pages that an array of LARGE bytes and more begins and ends with: transforms and products walk
 * through more places at once than the processor keeps addresses of 4 KiB pages for, and a kernel
 * that is asked for one small page after the other takes longer than it does to clear them. */
enum { LARGE_PAGE = 2 << 20, LARGE = 2 * LARGE_PAGE };

/* Large arrays begin in as many places of their page, in turn, or the same elements of several
 * would compete for the same lines of a second-level cache. */
enum { PLACES = 31 };

static char *aligned(char *address, size_t alignment)
{
    const intptr_t at = (intptr_t)address;
    return address + (v2v_round_up(at, (int64_t)alignment) - at);
}

static int is_large(size_t bytes)
{
    return bytes >= LARGE;
}

/** A cache line; of what may be written to a disk as it is, a page. */
static size_t alignment_of(size_t bytes)
{
    return bytes < (size_t)1 << 20 ? 64 : V2V_PAGE_BYTES;
}

/** Of an array, its header and what aligns them: all that is taken for it. */
static size_t bytes_around(size_t bytes)
{
    return bytes + (is_large(bytes) ? 2 * (size_t)LARGE_PAGE
                                    : sizeof(struct header) + alignment_of(bytes) - 1);
}

/** Zeros that nobody has touched: they are on the memory of whoever uses them first. */
static char *take_large(char **raw, size_t bytes)
{
    static _Atomic unsigned taken;
    const size_t place = (1 + taken++ % PLACES) * V2V_PAGE_BYTES;
    *raw =
        mmap(NULL, bytes_around(bytes), PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (*raw == MAP_FAILED) {
        return NULL;
    }
    char *first = aligned(*raw, LARGE_PAGE);
    const size_t pages = (place + bytes + LARGE_PAGE / 2) / LARGE_PAGE;
    (void)madvise(first, pages * LARGE_PAGE, MADV_HUGEPAGE); /* a wish */
    return first + place;
}

/** By calloc, aligned by hand. */
static char *take_small(char **raw, size_t bytes)
{
    *raw = calloc(1, bytes_around(bytes));
    return *raw != NULL ? aligned(*raw + sizeof(struct header), alignment_of(bytes)) : NULL;
}

static void *take(size_t bytes, int64_t label)
{
    char *raw = NULL;
    if (bytes > (size_t)PTRDIFF_MAX - 2 * (size_t)LARGE_PAGE) {
        return NULL;
    }
    char *memory = is_large(bytes) ? take_large(&raw, bytes) : take_small(&raw, bytes);
    if (memory == NULL) {
        return NULL;
    }
    struct header *header = (struct header *)(void *)memory - 1;
    *header = (struct header){.raw = raw, .bytes = bytes, .magic = magic_taken, .label = label};
    GUARD(header, sizeof *header);
    GUARD(memory + bytes, (size_t)(raw + bytes_around(bytes) - (memory + bytes)));
    return memory;
}

static void give_back(const struct header *header)
{
    char *raw = header->raw;
    const size_t bytes = header->bytes;
    if (is_large(bytes)) {
        UNGUARD(raw, bytes_around(bytes));
        (void)munmap(raw, bytes_around(bytes));
    } else {
        free(raw);
    }
}

static size_t read_locked(const size_t *value)
{
    pthread_mutex_lock(&account.lock);
    size_t copy = *value;
    pthread_mutex_unlock(&account.lock);
    return copy;
}

void *v2v_mem_alloc(const char *label, int64_t count, size_t size)
{
    size_t bytes = 0;
    void *memory = NULL;
    if (count < 0 || __builtin_mul_overflow((size_t)count, size, &bytes)) {
        (void)V2V_FAIL(V2V_E_MEMORY, "%s: %lld elements of %zu bytes are more than a size can hold",
                       label, (long long)count, size);
        return NULL;
    }
    if (V2V_FAULT_POINT("mem") != V2V_OK) {
        (void)V2V_FAIL(V2V_E_MEMORY, "%s: out of memory (injected)", label);
        return NULL;
    }
    int64_t index = account_take(label, bytes);
    if (index < 0) {
        (void)V2V_FAIL(V2V_E_MEMORY,
                       "%s: %zu bytes do not fit: %zu of the limit of %zu bytes are held", label,
                       bytes, v2v_mem_held(), read_locked(&account.limit));
        return NULL;
    }
    memory = take(bytes, index);
    if (memory == NULL) {
        account_give(index, bytes);
        (void)V2V_FAIL(V2V_E_MEMORY, "%s: out of memory: %zu bytes wanted, %zu held", label, bytes,
                       v2v_mem_held());
    }
    return memory;
}

void v2v_mem_free(void *memory)
{
    if (memory == NULL) {
        return;
    }
    struct header *header = (struct header *)memory - 1;
    UNGUARD(header, sizeof *header);
    V2V_ASSERT(header->magic == magic_taken);
    header->magic = 0;
    account_give(header->label, header->bytes);
    give_back(header);
}

void v2v_mem_set_limit(size_t bytes)
{
    pthread_mutex_lock(&account.lock);
    account.limit = bytes;
    pthread_mutex_unlock(&account.lock);
}

size_t v2v_mem_room(void)
{
    pthread_mutex_lock(&account.lock);
    const size_t left = account.limit > account.held ? account.limit - account.held : 0;
    const size_t room = account.limit == 0 ? SIZE_MAX : left;
    pthread_mutex_unlock(&account.lock);
    return room;
}

size_t v2v_mem_held(void)
{
    return read_locked(&account.held);
}

size_t v2v_mem_peak(void)
{
    return read_locked(&account.peak);
}

static int by_peak(const void *a, const void *b)
{
    size_t x = ((const struct label *)a)->peak, y = ((const struct label *)b)->peak;
    return (x < y) - (x > y);
}

void v2v_mem_report(void)
{
    const double mib = 1.0 / 1048576.0;
    struct label sorted[MOST_LABELS];
    pthread_mutex_lock(&account.lock);
    int64_t count = account.labels;
    size_t peak = account.peak, held = account.held;
    memcpy(sorted, account.label, sizeof sorted);
    pthread_mutex_unlock(&account.lock);

    qsort(sorted, (size_t)count, sizeof sorted[0], by_peak);
    v2v_log(V2V_LOG_INFO, "memory: peak %.1f MiB, %.1f MiB held", mib * (double)peak,
            mib * (double)held);
    for (int64_t i = 0; i < count; i++) {
        v2v_log(V2V_LOG_INFO, "memory: %12.1f MiB  %s, %zu bytes held",
                mib * (double)sorted[i].peak, sorted[i].name, sorted[i].held);
    }
}

int64_t v2v_mem_product(int64_t a, int64_t b, int64_t c)
{
    int64_t product = 0;
    if (a < 0 || b < 0 || c < 0) {
        return -1;
    }
    if (a == 0 || b == 0 || c == 0) {
        return 0;
    }
    if (__builtin_mul_overflow(a, b, &product) || __builtin_mul_overflow(product, c, &product)) {
        return -1;
    }
    return product;
}
