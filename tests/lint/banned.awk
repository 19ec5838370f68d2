# Input: file TAB line number TAB text without comments and strings.
BEGIN {
    FS = "\t"
    ban("atoi atol atoll atof", "", "no errors seen: v2v_text parses numbers")
    ban("strcpy strcat sprintf vsprintf gets", "", "no bound: snprintf")
    ban("rand srand random srandom drand48", "", "v2v_random draws by (seed, stream, counter)")
    ban("strtok", "", "hidden state: strtok_r or strcspn")
    ban("system popen", "", "no shell below a parallel program")
    ban("exit", "^src/cli/", "only cli ends the program; return a status")
    ban("printf puts putchar vprintf", "^src/cli/|^src/base/log\\.c$",
        "stdout belongs to cli, messages to v2v_log")
    ban("malloc calloc realloc free strdup strndup asprintf vasprintf aligned_alloc posix_memalign",
        "^src/base/memory\\.c$", "memory is labelled and counted: v2v_mem_alloc, v2v_mem_free")
    ban("MPI_Abort", "^src/par/", "a rank ends the job through par alone")
    # These hand out memory of the C library, which only free() takes back: a file that calls one of
    # them may call free().
    n = split("getline getdelim v2v_text_open v2v_config_text", list, " ")
    for (i = 1; i <= n; i++)
        needs_free[list[i]] = 1
}

{
    text = $3
    before = ""
    while (match(text, /[A-Za-z_][A-Za-z0-9_]*[ \t]*\(/)) {
        name = substr(text, RSTART, RLENGTH - 1)
        sub(/[ \t]+$/, "", name)
        before = before substr(text, 1, RSTART - 1)
        # a member called like the function (op->free(..)) is another thing
        if (name in needs_free)
            may_free[$1] = 1
        if (name in reason && before !~ /(\.|->)[ \t]*$/ &&
            (where[name] == "" || $1 !~ where[name])) {
            file[++found] = $1
            call[found] = name
            report[found] = $1 ":" $2 ": " name "(): " reason[name]
        }
        before = before substr(text, RSTART, RLENGTH)
        text = substr(text, RSTART + RLENGTH)
    }
}

END {
    for (i = 1; i <= found; i++)
        if (call[i] != "free" || !(file[i] in may_free))
            print report[i]
}

function ban(names, allowed_in, why,    n, i, list)
{
    n = split(names, list, " ")
    for (i = 1; i <= n; i++) {
        where[list[i]] = allowed_in
        reason[list[i]] = why
    }
}
