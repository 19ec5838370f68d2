# What gcov --no-output prints, summed by room. A header shows up once for every file that includes
# it: its best figure counts.
/^File '/ {
    file = substr($0, 7, length($0) - 7)
    if (index(file, root) == 1)
        file = substr(file, length(root) + 1)
    next
}

/^Lines executed:/ && file ~ /^(src|include)\// {
    split($0, part, /[:% ]+/)
    reached = part[3] / 100 * part[5]
    if (!(file in lines) || reached > hit[file])
        hit[file] = reached
    lines[file] = part[5]
    file = ""
}

END {
    for (file in lines) {
        split(file, part, "/")
        room = part[1] == "src" ? part[2] : "include/" part[3]
        room_lines[room] += lines[file]
        room_hit[room] += hit[file]
        all_lines += lines[file]
        all_hit += hit[file]
    }
    for (room in room_lines)
        printf "%-20s %6d lines %6.1f %%\n", room, room_lines[room],
            100 * room_hit[room] / room_lines[room] | "sort"
    close("sort")
    if (all_lines == 0) {
        print "no coverage data"
        exit 1
    }
    printf "%-20s %6d lines %6.1f %%\n", "all", all_lines, 100 * all_hit / all_lines
}
