function complain(reason)
{
    printf "%s:%d: %s\n", FILENAME, FNR, reason
}

FNR == 1 {
    opened = 0
}

{
    columns = $0
    gsub(/[\200-\277]/, "", columns) # the later bytes of a UTF-8 character
    if (length(columns) > 100)
        complain(length(columns) " columns, 100 are allowed")
}

FILENAME ~ /^src\// && FNR == 651 {
    complain("650 lines a file are allowed")
}

# clang-format puts the braces of a function, and of nothing else, into column 0 on their own
FILENAME ~ /^src\// && /^\{$/ {
    opened = FNR
}

/^\}$/ {
    if (opened && FNR - opened - 1 > 80)
        complain("a function of " (FNR - opened - 1) " lines, 80 are allowed")
    opened = 0
}
