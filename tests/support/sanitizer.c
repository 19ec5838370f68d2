const char *__asan_default_options(void);

/** What the address sanitizer asks a program for its settings. Slow unwinding: Open MPI unloads its
 *  plugins, and only whole stacks still name a library that lsan.supp can know. Null for sizes that
 *  no machine has: tests hand such sizes in and expect a failure. */
const char *__asan_default_options(void)
{
    return "fast_unwind_on_malloc=0:allocator_may_return_null=1";
}
