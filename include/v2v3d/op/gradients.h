#ifndef V2V3D_OP_GRADIENTS_H
#define V2V3D_OP_GRADIENTS_H

#ifdef __cplusplus
extern "C" {
#endif

/** Where a backward pass leaves what it computes; NULL: not wanted. */
struct v2v_gradients {
    float *din; /**< of the input */
    float *dweight, *dbias;
    int sets;       /**< 1: dweight and dbias are set; 0: added to */
    float in_slope; /**< negative slope (> 0) of the activation that the input went through: din is
                         of what came before it; 0: of the input as it is */
};

#ifdef __cplusplus
}
#endif

#endif
