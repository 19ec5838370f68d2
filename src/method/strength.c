#include "method/strength.h"

#include "method/square.h"
#include "method/unrolled.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/method/left_out.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/saturation.h"
#include "v2v3d/tensor/smooth.h"

#include <math.h>

/* Pixels of the square's side. */
enum { SIDE = 256 };

/* Means over 2 * REACH + 1 pixels along y and x vary as those by a Gaussian of 8 pixels do. */
enum { REACH = 13 };

struct chooser {
    struct v2v_square_views square;
    float *after;                 /* [z,height,width] */
    float *predicted, *corrected; /* [left out,height,width] */
    float *scratch, *smooth;      /* [height,width] */
    struct v2v_strength_sums all,
        fine; /* of a choice; of the latter, what is finer than 8 pixels */
};

/* Choices of views left out. */
enum { CHOICES = V2V_LEFT_OUT_CHOICES };

static void keep_fine(const struct chooser *self, float *image)
{
    v2v_smooth_image(self->smooth, self->scratch, image, self->square.height, self->square.width,
                     REACH);
    for (int64_t i = 0; i < self->square.height * self->square.width; i++) {
        image[i] -= self->smooth[i];
    }
}

/* Of the pixels that are judged. */
static void add(const struct chooser *self, struct v2v_strength_sums *sums, const float *missed,
                const float *correction)
{
    const struct v2v_part rows = self->square.judged.rows, columns = self->square.judged.columns;
    for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
        const int64_t first = y * self->square.width + columns.first;
        for (int64_t i = first; i < first + columns.count; i++) {
            sums->product += (double)missed[i] * (double)correction[i];
            sums->square += (double)correction[i] * (double)correction[i];
        }
    }
}

/* One view left out: what was missed of it before, and what the correction does about it. */
static void judge(struct chooser *self, const float *recorded, float *missed, float *correction)
{
    const int64_t pixels = self->square.height * self->square.width;
    const float highest = v2v_saturated_value(recorded, pixels);
    for (int64_t i = 0; i < pixels; i++) {
        const int tells = v2v_sample_tells(recorded[i], missed[i], highest);
        correction[i] = tells ? correction[i] - missed[i] : 0.0f;
        missed[i] = tells ? recorded[i] - missed[i] : 0.0f;
    }
    add(self, &self->all, missed, correction);
    keep_fine(self, missed);
    keep_fine(self, correction);
    add(self, &self->fine, missed, correction);
}

static enum v2v_status try_choice(struct chooser *self, const struct v2v_problem *problem,
                                  int64_t choice)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = self->square.height * self->square.width;
    struct v2v_left_out *fold = NULL;
    v2v_watchdog_beat("the strength of a correction");
    V2V_TRY(v2v_left_out_choose(&fold, &v2v_estimator_unrolled, problem, choice, NULL));
    V2V_TRY(v2v_left_out_run(fold, self->after, self->square.views,
                             v2v_square_averaging(&self->square)));
    v2v_left_out_predict(fold, self->corrected, self->after);
    v2v_left_out_predict(fold, self->predicted, v2v_unrolled_start(fold->estimator));
    for (int64_t i = fold->used; i < fold->views; i++) {
        const int64_t at = (i - fold->used) * pixels;
        judge(self, self->square.views + fold->view[i] * pixels, self->predicted + at,
              self->corrected + at);
    }
done:
    v2v_left_out_destroy(&fold);
    return rc;
}

static enum v2v_status prepare(struct chooser *self, const struct v2v_problem *problem,
                               const float *views, const struct v2v_averaging *averaging)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = problem->psf;
    V2V_TRY(v2v_square_views_init(&self->square, problem, views, averaging, SIDE));
    const int64_t pixels = v2v_mem_product(self->square.height, self->square.width, 1);
    const struct {
        float **images;
        int64_t count;
    } memory[] = {{&self->after, psf->slices},
                  {&self->predicted, V2V_LEFT_OUT_MOST},
                  {&self->corrected, V2V_LEFT_OUT_MOST},
                  {&self->scratch, 1},
                  {&self->smooth, 1}};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        V2V_TRY(
            V2V_ALLOC(*memory[i].images, "strength", v2v_mem_product(memory[i].count, pixels, 1)));
    }
done:
    return rc;
}

/* This rank's choices: one each, as far as they go. */
static enum v2v_status try_choices(struct v2v_strength_sums fine[CHOICES],
                                   struct v2v_strength_sums all[CHOICES], struct chooser *self,
                                   const struct v2v_problem *problem, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    for (int64_t i = v2v_comm_rank(comm); i < CHOICES; i += v2v_comm_size(comm)) {
        self->fine = self->all = (struct v2v_strength_sums){0};
        V2V_TRY(try_choice(self, problem, i));
        fine[i] = self->fine;
        all[i] = self->all;
    }
done:
    return rc;
}

/* Over the choices of all ranks, in one order. Collective(comm). */
static struct v2v_strength_sums sum_of(const struct v2v_strength_sums mine[CHOICES],
                                       const struct v2v_comm *comm)
{
    struct v2v_strength_sums sum = {0};
    double found[2 * CHOICES];
    for (int i = 0; i < CHOICES; i++) {
        found[2 * i] = mine[i].product;
        found[2 * i + 1] = mine[i].square;
    }
    v2v_par_sum_f64(comm, found, 2 * CHOICES);
    for (int i = 0; i < CHOICES; i++) {
        sum.product += found[2 * i];
        sum.square += found[2 * i + 1];
    }
    return sum;
}

static double best_of(const struct v2v_strength_sums *sums)
{
    return sums->product / sums->square;
}

/* Twice the best leaves as much missed as nothing. */
static double most_of(const struct v2v_strength_sums *sums)
{
    return 2.0 * best_of(sums);
}

double v2v_strength_of(const struct v2v_strength_sums *fine, const struct v2v_strength_sums *all)
{
    return fmax(0.0, fmin(fmin(best_of(fine), most_of(all)), 1.0));
}

enum v2v_status v2v_strength_choose(double *strength, const struct v2v_problem *problem,
                                    const float *views, const struct v2v_averaging *averaging,
                                    const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct chooser self = {0};
    struct v2v_strength_sums fine[CHOICES] = {0}, all[CHOICES] = {0};
    struct v2v_problem own = *problem;
    struct v2v_config config = *problem->config;
    *strength = 1.0;
    if (problem->psf->views <= CHOICES) {
        goto done;
    }
    V2V_TRY(v2v_par_agree(comm, prepare(&self, problem, views, averaging)));
    config.recon.strength = (struct v2v_number){V2V_NUMBER_GIVEN, 1.0};
    own.config = &config;
    own.height = self.square.height;
    own.width = self.square.width;
    V2V_TRY(v2v_par_agree(comm, try_choices(fine, all, &self, &own, comm)));
    const struct v2v_strength_sums of_fine = sum_of(fine, comm), of_all = sum_of(all, comm);
    if (!(of_fine.square > 0.0)) {
        v2v_log(V2V_LOG_INFO, "the frame has no light to choose the strength of the network's "
                              "correction by: all of it is taken");
        goto done;
    }
    *strength = v2v_strength_of(&of_fine, &of_all);
    v2v_log(V2V_LOG_INFO,
            "%.2f of the network's correction is taken: views left out speak for %.2f, and miss no "
            "more by it up to %.2f",
            *strength, best_of(&of_fine), most_of(&of_all));
done:
    v2v_square_views_fini(&self.square);
    v2v_mem_free(self.after);
    v2v_mem_free(self.predicted);
    v2v_mem_free(self.corrected);
    v2v_mem_free(self.scratch);
    v2v_mem_free(self.smooth);
    return rc;
}
