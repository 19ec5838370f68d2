typedef int v2v_eval_is_empty;
