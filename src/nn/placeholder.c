typedef int v2v_nn_is_empty;
