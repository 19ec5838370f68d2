typedef int v2v_sim_is_empty;
