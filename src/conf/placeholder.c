typedef int v2v_conf_is_empty;
