#include "cli/command.h"

int main(int argc, char **argv)
{
    return v2v_cli_main(argc, argv);
}
