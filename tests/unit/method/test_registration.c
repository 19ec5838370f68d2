/* A view that is its prediction moved: the equations say by how much. */
#include "method/anderson.h"
#include "method/registration.h"
#include "support.h"
#include "v2v3d/tensor/blind.h"

#include <math.h>
#include <string.h>

enum { HEIGHT = 72, WIDTH = 80, PIXELS = HEIGHT * WIDTH, MOST_ROUNDS = 30 };

/* Light that two depths, -1 and 0.5, add to a pixel. */
static double light(double y, double x, double depth)
{
    return depth < 0.0 ? 1.0 + 0.4 * sin(0.21 * y + 0.3) * cos(0.17 * x)
                       : 0.7 + 0.3 * cos(0.19 * y) * sin(0.26 * x + 0.5);
}

/* A field's value at a pixel. */
static double field_at(const double *field, int y, int x)
{
    double of_y[V2V_FIELD_ORDERS], of_x[V2V_FIELD_ORDERS], row[V2V_FIELD_ORDERS];
    v2v_legendre(of_y, V2V_FIELD_ORDERS, v2v_field_place(y, HEIGHT));
    v2v_legendre(of_x, V2V_FIELD_ORDERS, v2v_field_place(x, WIDTH));
    v2v_field_row(row, field, of_y);
    return v2v_field_value(row, of_x);
}

/* What the view shows at its calibration, and that weighted by depth. */
static void show(float *image, float *deep, const struct v2v_view_calibration *view)
{
    static const double depths[2] = {-1.0, 0.5};
    for (int i = 0; i < PIXELS; i++) {
        double sum = 0.0, weighted = 0.0;
        const int y = i / WIDTH, x = i % WIDTH;
        const double from_y = y - view->shift[0] - field_at(view->distortion_y, y, x);
        const double from_x = x - view->shift[1] - field_at(view->distortion_x, y, x);
        for (int d = 0; d < 2; d++) {
            const double s = light(from_y - view->slope[0] * depths[d],
                                   from_x - view->slope[1] * depths[d], depths[d]);
            sum += s;
            weighted += depths[d] * s;
        }
        const double factor = view->gain * exp(field_at(view->shading, y, x));
        image[i] = (float)(factor * sum);
        deep[i] = (float)(factor * weighted);
    }
}

/* A round, of samples `times` as bright as those at `truth`, of which the first are blind. */
static void step(struct v2v_view_calibration *view, const struct v2v_view_calibration *truth,
                 float times, unsigned terms, int smoothing, int64_t blind)
{
    static float seen[PIXELS], predicted[PIXELS], deep[PIXELS];
    struct v2v_calibration c = {1, HEIGHT, WIDTH, view, NULL};
    struct v2v_registration registration;
    struct v2v_registration_images images;
    assert_ok(v2v_registration_images_init(&images, HEIGHT, WIDTH));
    show(seen, deep, truth);
    show(predicted, deep, view);
    for (int64_t i = 0; i < PIXELS; i++) {
        seen[i] = i < blind ? V2V_BLIND : times * seen[i];
    }
    v2v_registration_compare(&registration, &images, seen, predicted, deep, terms, smoothing,
                             v2v_registration_judged(HEIGHT), v2v_registration_judged(WIDTH));
    (void)v2v_registration_step(&c, &registration, terms, smoothing);
    v2v_registration_images_fini(&images);
}

/* The first pixels of a view are blind.
 * @return the farthest that any number of the view is from `truth` after the rounds */
static double fit_seen(struct v2v_view_calibration *view, const struct v2v_view_calibration *truth,
                       unsigned terms, int smoothing, int64_t blind)
{
    static float seen[PIXELS], predicted[PIXELS], deep[PIXELS];
    struct v2v_calibration c = {1, HEIGHT, WIDTH, view, NULL};
    struct v2v_registration registration;
    struct v2v_registration_images images;
    const struct v2v_part rows = v2v_registration_judged(HEIGHT);
    const struct v2v_part columns = v2v_registration_judged(WIDTH);
    double moved = 1.0, farthest = 0.0;
    assert_ok(v2v_registration_images_init(&images, HEIGHT, WIDTH));
    show(seen, deep, truth);
    for (int64_t i = 0; i < blind; i++) {
        seen[i] = V2V_BLIND;
    }
    for (int r = 0; r < MOST_ROUNDS && moved > 1e-6; r++) {
        show(predicted, deep, view);
        v2v_registration_compare(&registration, &images, seen, predicted, deep, terms, smoothing,
                                 rows, columns);
        moved = v2v_registration_step(&c, &registration, terms, smoothing);
    }
    const double *a = (const double *)(const void *)view;
    const double *b = (const double *)(const void *)truth;
    for (size_t i = 0; i < sizeof *view / sizeof *a; i++) {
        farthest = fmax(farthest, fabs(a[i] - b[i]));
    }
    v2v_registration_images_fini(&images);
    return farthest;
}

static double fit(struct v2v_view_calibration *view, const struct v2v_view_calibration *truth,
                  unsigned terms, int smoothing)
{
    return fit_seen(view, truth, terms, smoothing, 0);
}

/* At the truth the prediction is what is seen, to float32's rounding, whatever the differences. */
static void all_that_is_asked_for_is_found(void **state)
{
    (void)state;
    const struct v2v_view_calibration shifted = {.gain = 0.8, .shift = {2.5, -1.75}};
    struct v2v_view_calibration sloped = shifted, all;
    struct v2v_view_calibration view = {.gain = 1.0};
    assert_true(fit(&view, &shifted, V2V_REGISTER_SHIFT, 1) < 1e-4);
    view = (struct v2v_view_calibration){.gain = 1.0};
    assert_true(fit(&view, &shifted, V2V_REGISTER_SHIFT, 3) < 1e-4);
    sloped.slope[0] = 0.75;
    sloped.slope[1] = -0.5;
    view = (struct v2v_view_calibration){.gain = 1.0};
    assert_true(fit(&view, &sloped, V2V_REGISTER_SHIFT | V2V_REGISTER_SLOPE, 1) < 1e-3);
    all = sloped;
    for (int k = 0; k < V2V_FIELD_COARSE_TERMS; k++) {
        all.distortion_y[k] = 0.08 * (k % 5 - 1);
        all.distortion_x[k] = 0.15 - 0.06 * (k % 5);
        all.shading[k] = 0.02 * (k % 5) - 0.05;
    }
    view = (struct v2v_view_calibration){.gain = 1.0};
    assert_true(fit(&view, &all, V2V_REGISTER_SHIFT | V2V_REGISTER_SLOPE | V2V_REGISTER_FIELDS, 1) <
                5e-3);
}

/* Derivatives are those of the smoothed image, and a gain at most doubles at once: rounds would
 * come to the same end without. */
static void a_round_goes_as_far_as_it_should(void **state)
{
    (void)state;
    const struct v2v_view_calibration there = {.gain = 1.0},
                                      moved = {.gain = 1.0, .shift = {0.2, -0.1}};
    struct v2v_view_calibration view = there;
    step(&view, &moved, 1.0f, V2V_REGISTER_SHIFT, 3, 0);
    assert_true(fabs(view.shift[0] - 0.2) < 0.03 && fabs(view.shift[1] + 0.1) < 0.03);
    view = there;
    step(&view, &there, 4.0f, V2V_REGISTER_SHIFT, 1, 0);
    assert_true(fabs(view.gain - 2.0) < 1e-6);
}

/* .. and beside blind samples: the upper half of what is judged. */
static void blind_samples_count_for_nothing(void **state)
{
    (void)state;
    enum { BLIND = HEIGHT / 2 * WIDTH + WIDTH / 3 };
    const struct v2v_view_calibration truth = {
        .gain = 0.8, .shift = {2.5, -1.75}, .slope = {0.75, -0.5}};
    struct v2v_view_calibration view = {.gain = 1.0}, coarse = {.gain = 1.0};
    const unsigned terms = V2V_REGISTER_SHIFT | V2V_REGISTER_SLOPE;
    assert_true(fit_seen(&view, &truth, terms, 1, BLIND) < 1e-3);
    assert_true(fit_seen(&coarse, &truth, terms, 3, BLIND) < 1e-3);
    const struct v2v_view_calibration there = {.gain = 1.0};
    view = there;
    step(&view, &there, 1.1f, V2V_REGISTER_SHIFT, 3, BLIND); /* nor those smoothed with them */
    assert_true(fabs(log(view.gain) - 0.1) < 1e-5);          /* the step is of a logarithm */
    assert_true(fabs(view.shift[0]) < 1e-5 && fabs(view.shift[1]) < 1e-5);
    float recorded[4] = {2.0f, V2V_BLIND, 4.0f, 0.0f};
    const float prediction[4] = {1.0f, 100.0f, 2.0f, 0.0f};
    const struct v2v_part line = {0, 1}, all = {0, 4};
    const struct v2v_missed missed = v2v_registration_missed(recorded, prediction, 4, line, all);
    assert_true(missed.squares == 5.0 && missed.of == 20.0);
}

/* How far two views' displacements are apart, pixels, root mean square over what is judged. */
static double apart(const struct v2v_view_calibration *a, const struct v2v_view_calibration *b)
{
    const struct v2v_part rows = v2v_registration_judged(HEIGHT);
    const struct v2v_part columns = v2v_registration_judged(WIDTH);
    double squares = 0.0;
    for (int64_t i = 0; i < rows.count * columns.count; i++) {
        const int y = (int)(rows.first + i / columns.count);
        const int x = (int)(columns.first + i % columns.count);
        const double dy = a->shift[0] + field_at(a->distortion_y, y, x) - b->shift[0] -
                          field_at(b->distortion_y, y, x);
        const double dx = a->shift[1] + field_at(a->distortion_x, y, x) - b->shift[1] -
                          field_at(b->distortion_x, y, x);
        squares += dy * dy + dx * dx;
    }
    return sqrt(squares / (double)(rows.count * columns.count));
}

/* Where pixels go is compared: of so few a single number is hard to tell. Fine fields are drawn to
 * 0, so that a part of what is missed stays. */
static void fine_fields_are_found_where_they_are_asked_for(void **state)
{
    (void)state;
    const unsigned coarse = V2V_REGISTER_SHIFT | V2V_REGISTER_FIELDS;
    struct v2v_view_calibration truth = {.gain = 0.9, .shift = {0.5, -0.25}};
    struct v2v_view_calibration view = {.gain = 1.0};
    truth.distortion_y[V2V_FIELD_COARSE_TERMS + 2] = 2.0;  /* P2(x) P2(y) */
    truth.distortion_x[V2V_FIELD_COARSE_TERMS + 3] = -1.5; /* P1(x) P3(y) */
    fit(&view, &truth, coarse, 1);
    const double before = apart(&view, &truth);
    assert_true(view.distortion_y[V2V_FIELD_COARSE_TERMS + 2] == 0.0);
    fit(&view, &truth, coarse | V2V_REGISTER_FINE_FIELDS, 1);
    const double after = apart(&view, &truth);
    print_message("apart: %.3f pixels without fine fields, %.3f with\n", before, after);
    assert_true(after < 0.5 * before);
}

static void what_is_not_asked_for_stays(void **state)
{
    (void)state;
    const struct v2v_view_calibration truth = {
        .gain = 1.1, .shift = {0.5, 0.5}, .slope = {0.5, 0.0}, .shading = {0.1}};
    struct v2v_view_calibration view = {.gain = 1.0};
    fit(&view, &truth, V2V_REGISTER_SHIFT, 1);
    assert_true(view.slope[0] == 0.0 && v2v_field_is_zero(view.shading));
    assert_true(view.gain != 1.0 && view.shift[0] != 0.0 && view.shift[1] != 0.0);
}

static void a_dark_view_stays_where_it_is(void **state)
{
    (void)state;
    static const float dark[PIXELS];
    struct v2v_view_calibration view = {.gain = 1.0};
    struct v2v_calibration c = {1, HEIGHT, WIDTH, &view, NULL};
    struct v2v_registration registration;
    struct v2v_registration_images images;
    assert_ok(v2v_registration_images_init(&images, HEIGHT, WIDTH));
    v2v_registration_compare(&registration, &images, dark, dark, dark, V2V_REGISTER_SHIFT, 1,
                             v2v_registration_judged(HEIGHT), v2v_registration_judged(WIDTH));
    assert_true(v2v_registration_step(&c, &registration, V2V_REGISTER_SHIFT, 1) == 0.0);
    assert_true(view.gain == 1.0 && view.shift[0] == 0.0);
    v2v_registration_images_fini(&images);
}

static void what_views_cannot_tell_is_taken_out(void **state)
{
    (void)state;
    enum { COUNT = 3 };
    double parallax[COUNT][2] = {{0.5, 0.1}, {-0.5, 0.3}, {0.0, -0.7}};
    struct v2v_view_calibration view[COUNT];
    struct v2v_calibration c = {COUNT, HEIGHT, WIDTH, view, NULL};
    static const double own[COUNT][2] = {{0.2, -0.1}, {0.2, 0.4}, {-0.4, -0.3}};
    double along = 0.0, squares = 0.0;
    for (int v = 0; v < COUNT; v++) { /* own: mean 0; its part along the parallax by hand */
        for (int axis = 0; axis < 2; axis++) {
            const double p = parallax[v][axis] - (axis == 0 ? 0.0 : -0.1);
            along += p * own[v][axis];
            squares += p * p;
        }
    }
    for (int v = 0; v < COUNT; v++) {
        view[v] = (struct v2v_view_calibration){.gain = 3.0 * exp(0.1 * (v - 1))};
        for (int axis = 0; axis < 2; axis++) {
            view[v].shift[axis] = own[v][axis] + 1.5 - axis + 2.0 * parallax[v][axis];
            view[v].slope[axis] = view[v].shift[axis];
        }
        view[v].distortion_y[3] = view[v].shift[0];
        view[v].distortion_x[3] = view[v].shift[1];
        view[v].shading[2] = 0.5 + 0.1 * (v - 1);
    }
    v2v_registration_fix_modes(&c, parallax);
    for (int v = 0; v < COUNT; v++) {
        assert_true(fabs(view[v].gain - exp(0.1 * (v - 1))) < 1e-12);
        assert_true(fabs(view[v].shading[2] - 0.1 * (v - 1)) < 1e-12);
        for (int axis = 0; axis < 2; axis++) {
            const double p = parallax[v][axis] - (axis == 0 ? 0.0 : -0.1);
            const double expected = own[v][axis] - along / squares * p;
            assert_true(fabs(view[v].shift[axis] - expected) < 1e-12);
            assert_true(fabs(view[v].slope[axis] - expected) < 1e-12);
            assert_true(fabs((axis == 0 ? view[v].distortion_y : view[v].distortion_x)[3] -
                             expected) < 1e-12);
        }
    }
}

/* Gains fall from 1 to 0.5 and from there to 0.1: the secant through both steps ends at -1.5. */
static void no_mixture_has_a_gain_that_is_not_positive(void **state)
{
    (void)state;
    static const double at[2] = {1.0, 0.5}, to[2] = {0.5, 0.1};
    struct v2v_view_calibration view = {.gain = 1.0};
    struct v2v_calibration c = {1, HEIGHT, WIDTH, &view, NULL};
    struct v2v_anderson *plain = NULL, *mixed = NULL;
    double x[V2V_REGISTER_NUMBERS], g[V2V_REGISTER_NUMBERS], gain = 0.0;
    assert_ok(v2v_anderson_create(&plain, 1));
    assert_ok(v2v_anderson_create(&mixed, V2V_REGISTER_NUMBERS));
    for (int k = 0; k < 2; k++) {
        gain = at[k];
        v2v_anderson_step(plain, &gain, &to[k]);
        view = (struct v2v_view_calibration){.gain = at[k], .shift = {0.25, -0.5}};
        v2v_registration_to_numbers(x, &c);
        view.gain = to[k];
        v2v_registration_to_numbers(g, &c);
        v2v_anderson_step(mixed, x, g);
        v2v_registration_from_numbers(&c, x);
    }
    assert_true(fabs(gain + 1.5) < 1e-12);
    assert_true(view.gain > 0.0 && view.shift[0] == 0.25 && view.shift[1] == -0.5);
    for (int sign = -1; sign <= 1; sign += 2) { /* whose exponentials are 0 and infinite */
        v2v_registration_to_numbers(x, &c);
        x[0] = sign * 1e4;
        v2v_registration_from_numbers(&c, x);
        assert_true(view.gain == (sign < 0 ? V2V_LEAST_GAIN : V2V_MOST_GAIN));
    }
    v2v_anderson_destroy(&mixed);
    v2v_anderson_destroy(&plain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_that_is_asked_for_is_found),
        cmocka_unit_test(a_round_goes_as_far_as_it_should),
        cmocka_unit_test(blind_samples_count_for_nothing),
        cmocka_unit_test(fine_fields_are_found_where_they_are_asked_for),
        cmocka_unit_test(what_is_not_asked_for_stays),
        cmocka_unit_test(a_dark_view_stays_where_it_is),
        cmocka_unit_test(what_views_cannot_tell_is_taken_out),
        cmocka_unit_test(no_mixture_has_a_gain_that_is_not_positive),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
