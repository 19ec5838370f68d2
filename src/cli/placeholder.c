typedef int v2v_cli_is_empty;
