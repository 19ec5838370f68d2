typedef int v2v_op_is_empty;
