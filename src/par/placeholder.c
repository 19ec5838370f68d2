typedef int v2v_par_is_empty;
