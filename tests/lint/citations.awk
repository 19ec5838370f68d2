# Input: the paths of all files, a line "==", then file TAB line number TAB text of those to look at
# (src/REFERENCE.md among them; its headings are wanted only at the end).
BEGIN {
    FS = "\t"
}

!listed {
    if ($0 == "==") {
        listed = 1
    } else {
        path = substr($0, 3)
        here[path] = 1
        while (sub(/\/[^\/]*$/, "", path))
            here[path] = 1
        name = $0
        sub(/.*\//, "", name)
        if (name != "README.md")
            here[name] = 1
    }
    next
}

{
    text = substr($0, length($1) + length($2) + 3)
    folder = $1
    if (!sub(/[^\/]*$/, "", folder))
        folder = ""
    if ($1 == "src/REFERENCE.md" && match(text, /^## [0-9]+\./))
        section[substr(text, 4, RLENGTH - 4)] = 1
    if ($1 == "README.md" && $2 == most + 1)
        complain("more than " most " lines: the front page is short")
    documents(text)
    files(text)
    sections(text)
    elsewhere(" " tolower(text) " ", text)
    if ($1 ~ /\.md$/)
        links(text)
    if ($1 ~ /\.md$/ && text ~ /ctest .*-R/)
        tests(text)
}

END {
    for (i = 1; i <= cited; i++)
        if (!(number[i] in section))
            print place[i] ": src/REFERENCE.md has no section " number[i]
}

# Words like src/NAME.md: from the root, from the file's folder, or a name that is one file's alone.
function documents(rest,    word)
{
    gsub(/\$[A-Za-z_]+\/[^ ]*/, "", rest) # $folder/NAME.md of a script
    while (match(rest, /[A-Za-z0-9_.\/-]*[A-Za-z0-9_]\.md/)) {
        word = substr(rest, RSTART, RLENGTH)
        rest = substr(rest, RSTART + RLENGTH)
        if (rest !~ /^[A-Za-z0-9_]/ && !exists(word))
            complain("no document " word)
    }
}

# Words like tests/unit/base and src/base/text.c
function files(rest,    word)
{
    gsub(/\$[A-Za-z_]+\/[^ ]*/, "", rest)
    rest = " " rest
    while (match(rest, /[^A-Za-z0-9_.\/}<"](src|include|tests|tools|jobs|configs)\/[A-Za-z0-9_.\/*$-]+/)) {
        word = substr(rest, RSTART + 1, RLENGTH - 1)
        rest = substr(rest, RSTART + RLENGTH)
        sub(/[.\/]+$/, "", word)
        # a program is called like its source
        if (word !~ /[A-Z*$]/ && !exists(word) && !exists(word ".c"))
            complain("no file " word)
    }
}

# REFERENCE.md 3; REFERENCE.md 3 and 4; REFERENCE.md 2, 9
function sections(rest,    list, n, i, words)
{
    while (match(rest, /REFERENCE\.md [0-9]+((,| and) [0-9]+)*/)) {
        list = substr(rest, RSTART + 13, RLENGTH - 13)
        rest = substr(rest, RSTART + RLENGTH)
        gsub(/,| and/, " ", list)
        n = split(list, words, / +/)
        for (i = 1; i <= n; i++) {
            number[++cited] = words[i]
            place[cited] = $1 ":" $2
        }
    }
}

function elsewhere(lower, text)
{
    if (lower ~ /[^a-z_](issues?|pull request) #?[0-9]/ || lower ~ /[^a-z_](the|this) issue[^a-z_]/)
        complain("cites an issue")
    if (lower ~ /[^a-z_](this|that|last|next|an?|earlier|previous) session[^a-z_]/)
        complain("cites a session")
    if (index(lower, "../shared") && $1 != "tests/CMakeLists.txt")
        complain("cites ../shared: V2V_SHARED names that folder")
    # a document by its name in capitals and a section: (NAME 2)
    if (match(text, /\([A-Z][A-Z][A-Z][A-Z]+ [0-9]+[a-z]?[),]/))
        complain("no document " substr(text, RSTART + 1, RLENGTH - 2))
}

# [words](path) and ![words](path), not to the web and not within the page
function links(rest,    path)
{
    while (match(rest, /\]\([^)]*\)/)) {
        path = substr(rest, RSTART + 2, RLENGTH - 3)
        rest = substr(rest, RSTART + RLENGTH)
        sub(/#.*/, "", path)
        if (path != "" && path !~ /^https?:/ && !exists(path))
            complain("a link to nowhere: " path)
    }
}

# KIND.ROOM and KIND.ROOM.NAME
function tests(rest,    words)
{
    gsub(/[^ ]*\/[^ ]*/, "", rest) # paths of files
    while (match(rest, /(unit|property|golden|mpi|stress|long)\.[a-z0-9_]+(\.[a-z0-9_]+)?/)) {
        split(substr(rest, RSTART, RLENGTH), words, ".")
        rest = substr(rest, RSTART + RLENGTH)
        if (!exists("tests/" words[1] "/" words[2] (words[3] == "" ? "" : "/test_" words[3] ".c")))
            complain("no test " words[1] "." words[2] (words[3] == "" ? "" : "." words[3]))
    }
}

function exists(path)
{
    sub(/^\.\//, "", path)
    sub(/\/$/, "", path)
    return (path in here) || (normal(folder path) in here)
}

# a/b/../c is a/c
function normal(path)
{
    while (match(path, /[^\/]+\/\.\.\//))
        path = substr(path, 1, RSTART - 1) substr(path, RSTART + RLENGTH)
    return path
}

function complain(reason)
{
    printf "%s:%d: %s\n", $1, $2, reason
}
