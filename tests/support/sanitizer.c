/* What the sanitizers need from a program that loads Open MPI; linked into each test and v2v3d. */

const char *__asan_default_options(void);
int dlclose(void *handle);

/** Null for sizes that no machine has: tests hand such sizes in and expect a failure. */
const char *__asan_default_options(void)
{
    return "allocator_may_return_null=1";
}

/** Open MPI unloads its plugins and leaks what they took. Here they stay loaded: the leak check
 *  then finds their names, which lsan.supp knows, next to the allocation, and needn't walk whole
 *  stacks at each allocation nor read the process's map again for each leak. */
int dlclose(void *handle)
{
    (void)handle;
    return 0;
}
