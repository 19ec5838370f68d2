/** Total variation, or another method, on the small microscope, by settings that a test may
 *  change. */
#ifndef TEST_SMALL_TV_H
#define TEST_SMALL_TV_H

#include "small_optics.h"

#include "v2v3d/method/estimator.h"

static struct v2v_config config;
static const char *method = "tv";
static int64_t iterations; /* of the last estimate */

static int setup(void **state)
{
    (void)state;
    v2v_config_defaults(&config);
    method = "tv";
    return 0;
}

static enum v2v_status estimate(float *volume, const float *views, const struct v2v_psf_file *psf,
                                int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_estimator *estimator = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = psf, .height = height, .width = width};
    assert_ok(v2v_estimator_find(&ops, method));
    V2V_TRY(v2v_estimator_create(&estimator, ops, &problem, NULL));
    rc = ops->run(estimator, &volume, views, NULL);
    iterations = estimator->iterations;
done:
    v2v_estimator_destroy(&estimator);
    return rc;
}

#endif
