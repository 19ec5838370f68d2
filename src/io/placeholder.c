typedef int v2v_io_is_empty;
