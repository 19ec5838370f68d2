typedef int v2v_fft_is_empty;
