typedef int v2v_train_is_empty;
