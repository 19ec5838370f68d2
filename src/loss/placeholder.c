typedef int v2v_loss_is_empty;
