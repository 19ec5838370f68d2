# Input: file TAB line number TAB text; first the rooms' CMake files, then the C files.
BEGIN {
    FS = "\t"
    # The floors of the house (DESIGN 2), ground floor first.
    floor_count = split("base;par tensor conf;io fft op;optics;nn;v2v loss;method;train recon eval sim;" \
                        "bench;cli", floors, ";")
    for (f = 1; f <= floor_count; f++) {
        n = split(floors[f], names, " ")
        for (i = 1; i <= n; i++)
            floor_of[names[i]] = f
    }
    # outside header (start of its name) -> rooms that may include it
    owner["mpi.h"] = " par fft io "
    owner["hdf5"] = " io "
    owner["H5"] = " io "
    owner["tiff"] = " io "
    owner["png.h"] = " io "
    owner["jansson"] = " io "
    owner["fftw3"] = " fft "
    owner["cblas"] = " op "
    owner["openblas"] = " op "
    owner["oneapi/"] = " op "
    owner["dnnl"] = " op "
    owner["yaml"] = " conf "
    owner["cyaml"] = " conf "
    # private header -> rooms that may see it all the same: mpi.h keeps it out of include/
    shared["par/comm_mpi.h"] = " io fft "
}

$1 ~ /CMakeLists\.txt$/ {
    read_room()
    next
}

match($3, /^[ \t]*#[ \t]*include[ \t]*["<][^">]*[">]/) {
    header = substr($3, RSTART, RLENGTH - 1)
    sub(/^.*["<]/, "", header)
    check_include(header)
}

# v2v_room(NAME ROOMS a b LIBRARIES c), over any number of lines.
function read_room(    text, n, words, i, room)
{
    text = $3
    sub(/#.*/, "", text)
    if (match(text, /v2v_room\(/)) {
        call = ""
        text = substr(text, RSTART + RLENGTH)
        reading = 1
    }
    if (!reading)
        return
    call = call " " text
    if (text !~ /\)/)
        return
    reading = 0
    sub(/\).*/, "", call)
    n = split(call, words, " ")
    room = words[1]
    if (!(room in floor_of)) {
        complain("room " room " is on no floor of tests/lint/arrows.awk")
        return
    }
    section = ""
    for (i = 2; i <= n; i++) {
        if (words[i] == "ROOMS" || words[i] == "LIBRARIES") {
            section = words[i]
        } else if (section == "ROOMS") {
            allowed[room, words[i]] = 1
            if (!(words[i] in floor_of) || floor_of[words[i]] >= floor_of[room])
                complain("room " room " names " words[i] ", which is not below it")
        }
    }
}

function check_include(header,    path, room, other, n, start)
{
    n = split($1, path, "/")
    if (path[1] == "src" && n > 2)
        room = path[2]
    else if (path[1] == "include" && n > 3)
        room = path[3]
    else
        room = ""
    for (start in owner)
        if (index(header, start) == 1 && (path[1] == "include" ||
                                          index(owner[start], " " room " ") == 0))
            complain("<" header "> belongs to" owner[start] "alone, never to include/")
    n = split(header, path, "/")
    other = path[1] == "v2v3d" ? path[2] : path[1]
    if (n < 2 || !(other in floor_of) || other == room)
        return
    if (room != "" && !((room, other) in allowed))
        complain("room " room " includes " header " but its CMakeLists.txt does not name " other)
    else if (path[1] != "v2v3d" && index(shared[header], " " room " ") == 0)
        complain(header " is private to room " other)
}

function complain(reason)
{
    printf "%s:%d: %s\n", $1, $2, reason
}
