typedef int v2v_base_is_empty;
