typedef int v2v_optics_is_empty;
