#ifndef V2V3D_CONF_LOSS_TERMS_H
#define V2V3D_CONF_LOSS_TERMS_H

/** The terms of the loss, a row each: ROW(NAME, name, meaning, weight by profile ..). Configuration
 *  keys, entries of metrics.jsonl and the loss itself are made from the rows; a new term is a row
 *  and the function v2v_term_name of src/loss/terms.c.
 *
 *  Those of views judge a projection by the view that its volume has not seen, those of volumes a
 *  volume and the mean of all outputs' volumes. Weights: what "auto" means in the reference, in the
 *  paper.
 *  @source REFERENCE.md 5 */
#define V2V_LOSS_VIEW_TERMS(ROW)                                                                   \
    ROW(MSE, mse, "weight of the squared differences; none: 0", 1.0, 1.0)                          \
    ROW(FFT, fft, "weight of the differences in the frequency domain", 0.5, 0.1)

#define V2V_LOSS_VOLUME_TERMS(ROW)                                                                 \
    ROW(POS, pos, "weight of negative voxels", 1e-3, 0.0)                                          \
    ROW(DC, dc, "weight of the de-crosstalk term", 1e-2, 1.0)                                      \
    ROW(TV, tv, "weight of the axial smoothness", 1e-3, 0.0)

/** Which weights "auto" means, and what they multiply. */
enum v2v_loss_profile { V2V_LOSS_REFERENCE, V2V_LOSS_PAPER, V2V_LOSS_PROFILES };

/** The terms in the order of their rows, and their weighted sum. */
enum v2v_loss_term {
#define V2V_LOSS_ENTRY(NAME, ...) V2V_LOSS_##NAME,
    V2V_LOSS_VIEW_TERMS(V2V_LOSS_ENTRY) V2V_LOSS_VOLUME_TERMS(V2V_LOSS_ENTRY)
#undef V2V_LOSS_ENTRY
        V2V_LOSS_TOTAL,
    V2V_LOSS_TERMS
};

#endif
