# Sourced by every lint: goes to the tree to look at and says how to find its files.
# shellcheck shell=bash
set -euo pipefail
# Bytes, not characters: the same answer from every awk and in every locale.
export LC_ALL=C
# The awk programs lie beside the scripts.
lint_folder=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
export lint_folder
cd "${1:-$lint_folder/../..}"
[[ -d src && -d include ]] || { echo "$PWD is not the project's root"; exit 2; }

# Skips the lint when one of the tools is missing.
need()
{
    local tool
    for tool in "$@"; do
        if ! command -v "$tool" >/dev/null; then
            echo "skipped: $tool is not installed"
            exit 77
        fi
    done
}

# The C files under the folders, in a fixed order.
c_files()
{
    local folder
    for folder in "$@"; do
        [[ ! -d $folder ]] || find "$folder" \( -name '*.c' -o -name '*.h' \) -type f
    done | sort
}

# Prints what a lint has found (stdin) and fails if that is anything.
verdict()
{
    local found
    found=$(cat)
    [[ -z $found ]] || { printf '%s\n' "$found"; exit 1; }
}
