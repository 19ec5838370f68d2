typedef int v2v_tensor_is_empty;
