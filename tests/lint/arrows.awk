# Input: file TAB line number TAB text.
BEGIN {
    FS = "\t"
    # outside header (start of its name) -> rooms that may include it
    owner["mpi.h"] = " par fft io "
    owner["hdf5"] = " io "
    owner["H5"] = " io "
    owner["tiff"] = " io "
    owner["png.h"] = " io "
    owner["zlib.h"] = " io "
    owner["jansson"] = " io "
    owner["libxml"] = " io "
    owner["fftw3"] = " fft "
    owner["cblas"] = " op "
    owner["openblas"] = " op "
    owner["oneapi/"] = " op "
    owner["dnnl"] = " op "
    owner["nlopt"] = " optics "
    owner["yaml"] = " conf "
    owner["cyaml"] = " conf "
}

match($3, /^[ \t]*#[ \t]*include[ \t]*["<][^">]*[">]/) {
    header = substr($3, RSTART, RLENGTH - 1)
    sub(/^.*["<]/, "", header)
    n = split($1, path, "/")
    room = path[1] == "src" && n > 2 ? path[2] : ""
    for (start in owner)
        if (index(header, start) == 1 && index(owner[start], " " room " ") == 0)
            printf "%s:%d: <%s> belongs to%salone, never to include/\n", $1, $2, header, owner[start]
}
