# C files without comments and without the content of string and character constants (kept with
# -v keep_strings=1). Output: file TAB line number TAB text.
FNR == 1 {
    in_comment = 0
}

{
    text = $0
    out = ""
    while (text != "") {
        if (in_comment) {
            at = index(text, "*/")
            if (at == 0)
                break
            text = substr(text, at + 2)
            in_comment = 0
            continue
        }
        if (!match(text, /\/\*|\/\/|["']/)) {
            out = out text
            break
        }
        out = out substr(text, 1, RSTART - 1)
        token = substr(text, RSTART, RLENGTH)
        text = substr(text, RSTART + RLENGTH)
        if (token == "//")
            break
        if (token == "/*") {
            in_comment = 1
            out = out " "
            continue
        }
        length_of_rest = constant_length(text, token)
        out = out token (keep_strings ? substr(text, 1, length_of_rest - 1) : "") token
        text = substr(text, length_of_rest + 1)
    }
    printf "%s\t%d\t%s\n", FILENAME, FNR, out
}

# Bytes up to and including the closing quote.
function constant_length(rest, quote,    i, c)
{
    for (i = 1; i <= length(rest); i++) {
        c = substr(rest, i, 1)
        if (c == "\\")
            i++
        else if (c == quote)
            return i
    }
    return length(rest)
}
