# Input: file TAB line number TAB text without comments. A line says something unless it is empty,
# an #include, or nothing but braces, brackets, commas and semicolons.
BEGIN {
    FS = "\t"
}

$1 != file {
    file = $1
    first[++files] = count + 1
}

{
    text = substr($0, length($1) + length($2) + 3)
    gsub(/[ \t]+/, " ", text)
    sub(/^ /, "", text)
    sub(/ $/, "", text)
    if (text ~ /^[][{}();, ]*$/ || text ~ /^# ?include/)
        next
    count++
    line[count] = text
    place[count] = $1 ":" $2
    file_of[count] = files
}

END {
    for (i = 1; i + block - 1 <= count; i++) {
        if (file_of[i] != file_of[i + block - 1])
            continue
        key = line[i]
        for (k = 1; k < block; k++)
            key = key "\n" line[i + k]
        if (!(key in seen)) {
            seen[key] = i
            continue
        }
        twin = seen[key]
        # lines that repeat within one block are a table, not a copied block
        if (file_of[twin] == file_of[i] && i - twin < block)
            continue
        for (k = block; same(i + k, twin + k, i); k++)
            ;
        printf "%s: %d lines stand at %s already\n", place[i], k, place[twin]
        i += k - 1
    }
}

function same(a, b, start)
{
    return a <= count && b < start && line[a] == line[b] && file_of[a] == file_of[a - 1] &&
           file_of[b] == file_of[b - 1]
}
