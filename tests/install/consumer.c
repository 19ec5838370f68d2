/* What a program outside does with the installed library, in what C and C++ have in common: a
 * function of every room that needs a library of its own. */
#include "v2v3d/base/memory.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/fft/fft2.h"
#include "v2v3d/io/apng.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/op/conv.h"
#include "v2v3d/par/comm.h"

#include <math.h>
#include <stdio.h>

enum { SIDE = 16, CHANNELS = 48 };

static enum v2v_status transform(double *there_and_back)
{
    enum { HALF = SIDE / 2 + 1 };
    float *image = (float *)v2v_mem_alloc("image", SIDE * SIDE, sizeof *image);
    struct v2v_complex *spectrum =
        (struct v2v_complex *)v2v_mem_alloc("spectrum", SIDE * HALF, sizeof *spectrum);
    struct v2v_fft2 *fft = NULL;
    enum v2v_status rc = v2v_fft2_create(&fft, SIDE, SIDE);
    if (rc == V2V_OK && image != NULL && spectrum != NULL) {
        image[3] = 2.0f;
        v2v_fft2_forward(fft, spectrum, image);
        v2v_fft2_inverse(fft, image, spectrum);
        *there_and_back = (double)image[3];
    }
    v2v_fft2_destroy(&fft);
    v2v_mem_free(image);
    v2v_mem_free(spectrum);
    return rc;
}

/* All weights 0: the bias of each channel is left. */
static enum v2v_status convolve(float *out, int backend, const float *in, const float *weight,
                                const float *bias)
{
    struct v2v_conv *conv = NULL;
    struct v2v_conv_spec spec = {};
    spec.batch = spec.kernel = spec.stride = 1;
    spec.in = spec.out = CHANNELS;
    spec.height = spec.width = SIDE;
    spec.slope = 1.0f;
    spec.method.backend = backend;
    enum v2v_status rc = v2v_conv_create(&conv, &spec);
    if (rc == V2V_OK) {
        v2v_conv_set_weights(conv, weight, bias);
        v2v_conv_forward(conv, out, in);
    }
    v2v_conv_destroy(&conv);
    return rc;
}

static int wrong(const char *what, enum v2v_status rc, double value, double expected)
{
    int is_wrong = rc != V2V_OK || !(fabs(value - expected) < 1e-3);
    if (is_wrong) {
        printf("%s: %g, not %g; %s\n", what, value, expected, v2v_status_message());
    }
    return is_wrong;
}

int main(int argc, char **argv)
{
    static float in[CHANNELS * SIDE * SIDE], out[CHANNELS * SIDE * SIDE];
    static float weight[CHANNELS * CHANNELS], bias[CHANNELS];
    double there_and_back = 0.0;
    struct v2v_comm *world = NULL;
    struct v2v_volume *volume = NULL;
    struct v2v_apng *film = NULL;
    struct v2v_config config;
    int failures = v2v_par_init(&world, &argc, &argv) != V2V_OK;
    v2v_config_defaults(&config);
    failures += argc < 2 || v2v_config_load(&config, argv[1]) != V2V_OK;
    failures += v2v_volume_open(&volume, "no_such_file.h5", NULL, world) != V2V_E_INPUT;
    failures += v2v_volume_open(&volume, "no_such_file.tif", NULL, world) != V2V_E_INPUT;
    failures += v2v_apng_create(&film, "no/such/film.png", 2, 5) != V2V_E_IO;
    enum v2v_status rc = transform(&there_and_back);
    failures += wrong("transform there and back", rc, there_and_back, 2.0 * SIDE * SIDE);
    bias[CHANNELS - 1] = 1.5f;
    for (int backend = V2V_BACKEND_ONEDNN; backend <= V2V_BACKEND_OPENBLAS; backend++) {
        rc = convolve(out, backend, in, weight, bias);
        failures += wrong("convolution", rc, out[CHANNELS * SIDE * SIDE - 1], 1.5);
    }
    v2v_par_finalize(&world);
    if (failures == 0) {
        printf("works\n");
    }
    return failures;
}
