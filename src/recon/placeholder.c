typedef int v2v_recon_is_empty;
