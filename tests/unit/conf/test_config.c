#include "support.h"

#include "v2v3d/conf/config.h"

#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/** Write a file into the test's folder and give its path, which lives until the next call. */
static const char *write_bytes(const char *bytes, size_t count)
{
    static char path[600];
    static const char *folder;
    if (folder == NULL) {
        folder = test_folder(NULL);
    }
    snprintf(path, sizeof path, "%s/settings.yaml", folder);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, count, file), count);
    assert_int_equal(fclose(file), 0);
    return path;
}

static enum v2v_status load_text(struct v2v_config *config, const char *text)
{
    v2v_config_defaults(config);
    return v2v_config_load(config, write_bytes(text, strlen(text)));
}

/** The example of conf/config.h. */
static enum v2v_status header_example(const char *path, int64_t *steps)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config config;
    v2v_config_defaults(&config);
    V2V_TRY(v2v_config_load(&config, path));
    V2V_TRY(v2v_config_set(&config, "train.steps=20"));
    V2V_TRY(v2v_config_check(&config));
    *steps = config.train.steps;
done:
    return rc;
}

static void header_example_works(void **state)
{
    (void)state;
    int64_t steps = 0;
    const char *text = "train:\n  steps: 7\n";
    assert_ok(header_example(write_bytes(text, strlen(text)), &steps));
    assert_int_equal(steps, 20);
}

static void defaults_are_those_of_the_method(void **state)
{
    (void)state;
    struct v2v_config c;
    v2v_config_defaults(&c);
    assert_int_equal(c.model.width, 128);
    assert_int_equal(c.model.features, 4);
    assert_true(c.train.learning_rate == 8e-5 && c.train.decay == 0.3);
    assert_true(c.train.beta1 == 0.9 && c.train.beta2 == 0.999 && c.train.epsilon == 1e-8);
    assert_int_equal(c.train.crop, V2V_WHOLE_AUTO);
    assert_int_equal(c.train.flips, 1);
    assert_int_equal(c.psf.normalize, V2V_NORMALIZE_VIEW);
    assert_int_equal(c.psf.reduce, V2V_REDUCE_SUM);
    assert_int_equal(c.loss.weight[V2V_LOSS_MSE].mode, V2V_NUMBER_AUTO);
    assert_int_equal(c.recon.skip.mode, V2V_NUMBER_NONE);
    assert_int_equal(c.deconv.lambda.mode, V2V_NUMBER_NONE);
    assert_true(c.deconv.lambda.value == 0.03);
}

/* The word of a number that is not given is its own. */
static void a_usual_number_is_called_default(void **state)
{
    (void)state;
    struct v2v_config c;
    assert_ok(load_text(&c, "deconv:\n  lambda: 0.5\n"));
    assert_int_equal(c.deconv.lambda.mode, V2V_NUMBER_GIVEN);
    assert_ok(load_text(&c, "deconv:\n  lambda: default\n"));
    assert_int_equal(c.deconv.lambda.mode, V2V_NUMBER_NONE);
    assert_true(c.deconv.lambda.value == 0.03);
    assert_int_equal(load_text(&c, "deconv:\n  lambda: none\n"), V2V_E_CONFIG);
    assert_int_equal(load_text(&c, "deconv:\n  lambda: off\n"), V2V_E_CONFIG);
    assert_int_equal(load_text(&c, "input:\n  offset: default\n"), V2V_E_CONFIG);
}

static void every_kind_of_value_is_read(void **state)
{
    (void)state;
    struct v2v_config c;
    assert_ok(load_text(&c, "# a comment\n"
                            "train: {steps: 12, flips: false, learning_rate: 1e-3}\n"
                            "psf:\n  normalize: \"none\"\n"
                            "input:\n  offset: none\n  gain: 2.5\n"
                            "loss:\n  mse: auto\n  fft: 0\n"
                            "recon:\n"));
    assert_int_equal(c.train.steps, 12);
    assert_int_equal(c.train.flips, 0);
    assert_true(c.train.learning_rate == 1e-3);
    assert_int_equal(c.psf.normalize, V2V_NORMALIZE_NONE);
    assert_int_equal(c.input.offset.mode, V2V_NUMBER_NONE);
    assert_int_equal(c.input.gain.mode, V2V_NUMBER_GIVEN);
    assert_true(c.input.gain.value == 2.5);
    assert_int_equal(c.loss.weight[V2V_LOSS_MSE].mode, V2V_NUMBER_AUTO);
    assert_int_equal(c.loss.weight[V2V_LOSS_FFT].mode, V2V_NUMBER_GIVEN);
    assert_true(c.loss.weight[V2V_LOSS_FFT].value == 0.0);
    assert_int_equal(c.demo.size, 128);
}

static void odd_but_valid_files_are_read(void **state)
{
    (void)state;
    struct v2v_config c;
    assert_ok(load_text(&c, ""));
    assert_ok(load_text(&c, "# nothing\n"));
    assert_ok(load_text(&c, "train:\r\n  steps: 5\r\n  crop: 64\r\n"));
    assert_int_equal(c.train.steps, 5);
    assert_ok(load_text(&c, "\xEF\xBB\xBFtrain:\n  steps: 6"));
    assert_int_equal(c.train.steps, 6);
    assert_ok(load_text(&c, "---\ntrain:\n  seed: 9223372036854775807\n...\n"));
    assert_true(c.train.seed == INT64_MAX);
}

struct bad {
    const char *text;
    const char *said; /**< must be in the message */
    const char *also;
};

static void bad_files_are_refused_by_line_and_reason(void **state)
{
    (void)state;
    static const struct bad cases[] = {
        {"train:\n  stepps: 5\n", ":2: ", "did you mean 'train.steps'?"},
        {"trian:\n  steps: 5\n", ":1: ", "did you mean 'train'?"},
        {"train:\n  zzzzzzzz: 5\n", ":2: ", "unknown key 'zzzzzzzz' of section 'train'"},
        {"train:\n  width: 5\n", ":2: ", "did you mean 'model.width'?"},
        {"steps: 5\n", ":1: ", "key of section 'train'"},
        {"qqqqqqqqq: 5\n", ":1: ", "unknown section"},
        {"train:\n  steps: 5\n  batch: 1\n  steps: 6\n", ":4: ", "given on line 2"},
        {"train:\n  steps: 5\npsf:\ntrain:\n  batch: 1\n", ":4: ", "duplicate section 'train'"},
        {"train:\n  steps: -1\n", ":2: train.steps: -1 ", "[1, 1000000000]"},
        {"train:\n  steps: 99999999999999999999\n", ":2: ", "is outside"},
        {"train:\n  steps: 5.5\n", ":2: ", "'5.5' is not a whole number"},
        {"train:\n  steps: five\n", ":2: ", "not a whole number"},
        {"train:\n  steps:\n", ":2: ", "train.steps has no value"},
        {"train:\n  steps: ~\n", ":2: ", "not a whole number"},
        {"train:\n  learning_rate: 1e309\n", ":2: ", "is outside"},
        {"train:\n  learning_rate: .nan\n", ":2: ", "not a number"},
        {"train:\n  learning_rate: nan\n", ":2: ", "not a number"},
        {"train:\n  learning_rate: 0,001\n", ":2: ", "'0,001' is not a number"},
        {"train:\n  learning_rate: 0x1p-3\n", ":2: ", "not a number"},
        {"train:\n  beta1: 1\n", ":2: ", "is outside"},
        {"train:\n  crop: 100\n", ":2: ", "not a multiple of 32"},
        {"train:\n  halo: 10\n\n  crop: 32\n  batch: 3\n", NULL, NULL},
        {"train:\n  halo: 16\n\n  crop: 32\n", ":4: train.crop: 32 ", "halo of 16"},
        {"train:\n  halo: 64\n  crop: 128\n", "train.crop: 128 ", "halo of 64"},
        {"train:\n  crop: -1\n", ":2: train.crop", "is outside"},
        {"train:\n  halo: auto\n", ":2: train.halo", "not a whole number"},
        {"train:\n  flips: yes\n", ":2: ", "is not false or true"},
        {"psf:\n  normalize: veiw\n", ":2: ", "'veiw' is not view or none"},
        {"recon:\n  skip: on\n", ":2: ", "'on' is not a number"},
        {"recon:\n  strength: none\n", ":2: ", "'none' is not a number"},
        {"deconv:\n  read_noise: off\n", ":2: ", "'off' is not a number"},
        {"train:\n  steps: [5]\n", ":2: ", "train.steps wants one word or number"},
        {"train:\n  steps: {a: 5}\n", ":2: ", "train.steps wants one word or number"},
        {"train: 5\n", ":1: ", "wants 'key: value' lines"},
        {"train:\n  - steps\n", ": section 'train'", "wants 'key: value' lines"},
        {"- train\n", ":1: ", "made of sections"},
        {"just text\n", ":1: ", "made of sections"},
        {"[train]: 5\n", ":1: ", "wants one word"},
        {"train:\n  steps: &a 5\n", ":2: ", "anchors and tags"},
        {"train:\n  steps: !!int 5\n", ":2: ", "anchors and tags"},
        {"train:\n  steps: *a\n", ":2: ", "wants one word"},
        {"train:\n  steps: \"5\\0\"\n", ":2: ", "NUL"},
        {"train:\n\tsteps: 5\n", ":2: ", "tab"},
        {"train:\n  steps: 5\n batch: 1\n", ":3: ", ""},
        {"train:\n  steps: \"5\n", ":", "quoted scalar"},
        {"train: {steps: 5\n", ":", "flow mapping"},
        {"train:\n  steps: 5\n---\npsf:\n", ":3: ", "only one YAML document"},
        {"train:\n  steps: \xff\xff\n", ":2: ", "UTF-8"},
        {"optics:\n  numerical_aperture: 1.5\n", ":2: ", "refractive_index"},
        {"optics:\n  needle_aperture: 1.2\n", ":2: ", "above optics.numerical_aperture"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct v2v_config c, before;
        enum v2v_status rc = load_text(&c, cases[i].text);
        if (cases[i].said == NULL) {
            assert_ok(rc);
            continue;
        }
        const char *message = v2v_status_message();
        if (rc != V2V_E_CONFIG || strstr(message, "settings.yaml:") == NULL ||
            strstr(message, cases[i].said) == NULL || strstr(message, cases[i].also) == NULL) {
            fail_msg("case %zu: %s gave %d: %s", i, cases[i].text, (int)rc, message);
        }
        v2v_config_defaults(&before);
        assert_memory_equal(&c, &before, sizeof c); /* a refused file changes nothing */
    }
}

static void files_that_are_no_text_are_refused(void **state)
{
    (void)state;
    struct v2v_config c;
    char *large = malloc(2 << 20);
    assert_non_null(large);
    memset(large, '#', 2 << 20);
    v2v_config_defaults(&c);
    assert_int_equal(v2v_config_load(&c, write_bytes("a:\n\0b", 5)), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), ":2: holds a NUL"));
    assert_ok(v2v_config_load(&c, write_bytes(large, 1 << 20)));
    assert_int_equal(v2v_config_load(&c, write_bytes(large, (1 << 20) + 1)), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "1 MiB"));
    free(large);
    assert_int_equal(v2v_config_load(&c, "/nonexistent/x.yaml"), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "/nonexistent/x.yaml"));
    assert_int_equal(v2v_config_load(&c, "/dev/zero"), V2V_E_CONFIG);
    assert_int_equal(v2v_config_load(&c, "/tmp"), V2V_E_CONFIG);
    char pipe[600];
    snprintf(pipe, sizeof pipe, "%s/pipe", test_folder(NULL));
    assert_int_equal(mkfifo(pipe, 0600), 0);
    assert_int_equal(v2v_config_load(&c, pipe), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "not a regular file"));
}

static void rules_between_settings_hold_for_all_of_them_together(void **state)
{
    (void)state;
    struct v2v_config c;
    v2v_config_defaults(&c);
    assert_ok(v2v_config_set(&c, "optics.numerical_aperture=1.4")); /* in water for now */
    assert_int_equal(v2v_config_check(&c), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "optics.numerical_aperture: 1.4 is not below"));
    assert_ok(v2v_config_set(&c, "optics.refractive_index=1.515"));
    assert_ok(v2v_config_check(&c));
    assert_ok(v2v_config_set(&c, "train.crop=32"));
    assert_int_equal(v2v_config_check(&c), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "train.crop: 32 leaves nothing inside"));
}

static void set_changes_one_value_or_nothing(void **state)
{
    (void)state;
    static const struct bad cases[] = {
        {"train.steps", "section.key=value", ""},
        {"steps=5", "section.key=value", ""},
        {"=", "section.key=value", ""},
        {"", "section.key=value", ""},
        {".=", "unknown section", ""},
        {"train.=5", "unknown key", ""},
        {"train.stps=5", "did you mean 'train.steps'?", ""},
        {"trainn.steps=5", "did you mean 'train'?", ""},
        {"train.steps=", "has no value", "--set: train.steps"},
        {"train.steps=0", "is outside", "--set: train.steps"},
        {"train.steps= 5", "not a whole number", ""},
        {"input.dataset=a\nb", "input.dataset: holds more than one line", ""},
        {"train.abcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuvwxyzabcdefghijklmnopqr=5",
         "names no key", ""},
    };
    struct v2v_config c, before;
    v2v_config_defaults(&c);
    before = c;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        enum v2v_status rc = v2v_config_set(&c, cases[i].text);
        const char *message = v2v_status_message();
        if (rc != V2V_E_CONFIG || strstr(message, cases[i].said) == NULL ||
            strstr(message, cases[i].also) == NULL) {
            fail_msg("'%s' gave %d: %s", cases[i].text, (int)rc, message);
        }
        assert_memory_equal(&c, &before, sizeof c);
    }
    assert_ok(v2v_config_set(&c, "train.halo=8"));
    assert_ok(v2v_config_set(&c, "train.crop=32"));
    assert_ok(v2v_config_set(&c, "loss.fft=0.1"));
    assert_ok(v2v_config_set(&c, "recon.precision=bf16"));
    assert_ok(v2v_config_set(&c, "train.precision=bf16-always"));
    assert_int_equal(c.train.crop, 32);
    assert_ok(v2v_config_set(&c, "train.crop=auto"));
    assert_int_equal(c.train.crop, V2V_WHOLE_AUTO);
    assert_true(c.loss.weight[V2V_LOSS_FFT].value == 0.1);
    assert_int_equal(c.recon.precision, V2V_PRECISION_BF16);
    assert_int_equal(c.train.precision, V2V_PRECISION_BF16_ALWAYS);
}

/** Print, load and compare. */
static void check_round_trip(const struct v2v_config *config, int comments)
{
    struct v2v_config back;
    char *text = NULL;
    size_t bytes = 0;
    FILE *stream = open_memstream(&text, &bytes);
    assert_non_null(stream);
    v2v_config_print(config, stream, NULL, comments);
    assert_int_equal(fclose(stream), 0);
    v2v_config_defaults(&back);
    assert_ok(v2v_config_load(&back, write_bytes(text, bytes)));
    assert_memory_equal(&back, config, sizeof back);
    assert_int_equal(comments != 0, strstr(text, "# ") != NULL);
    free(text);
}

/** By member: the padding between them stays zero, so that configurations compare by bytes. */
static void set_number(struct v2v_number *number, int mode, double value)
{
    number->mode = mode;
    number->value = value;
}

static void unusual_values(struct v2v_config *c)
{
    v2v_config_defaults(c);
    c->train.learning_rate = 1.0 / 3.0;
    c->train.epsilon = nextafter(1e-8, 1.0);
    c->train.decay = 0x1p-1074;
    c->train.beta1 = 0.1 + 0.2;
    c->train.flips = 0;
    c->train.seed = INT64_MAX;
    set_number(&c->input.offset, V2V_NUMBER_GIVEN, -123456.78901234567);
    set_number(&c->input.gain, V2V_NUMBER_NONE, 0.0);
    set_number(&c->loss.weight[V2V_LOSS_TV], V2V_NUMBER_GIVEN, 1e9);
    set_number(&c->recon.skip, V2V_NUMBER_GIVEN, 1e-300);
    c->model.backend = V2V_BACKEND_OPENBLAS;
    assert_ok(v2v_config_set(c, "input.dataset=/it's: #1, \"50 %\" {a} \xc3\xa4"));
}

static void print_reads_back_to_the_same_bits(void **state)
{
    (void)state;
    struct v2v_config c;
    for (int comments = 0; comments < 2; comments++) {
        v2v_config_defaults(&c);
        check_round_trip(&c, comments);
        unusual_values(&c);
        check_round_trip(&c, comments);
    }
}

static void decimal_comma_of_the_locale_changes_nothing(void **state)
{
    (void)state;
    static const char *const comma[] = {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "nl_NL.UTF-8"};
    struct v2v_config c;
    const char *found = NULL;
    for (size_t i = 0; found == NULL && i < sizeof comma / sizeof comma[0]; i++) {
        found = setlocale(LC_ALL, comma[i]);
    }
    if (found == NULL) {
        test_skip("no locale with a decimal comma is installed");
    }
    unusual_values(&c);
    check_round_trip(&c, 1);
    enum v2v_status rc = load_text(&c, "train:\n  learning_rate: 0,5\n");
    setlocale(LC_ALL, "C");
    assert_int_equal(rc, V2V_E_CONFIG);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(header_example_works),
        cmocka_unit_test(defaults_are_those_of_the_method),
        cmocka_unit_test(a_usual_number_is_called_default),
        cmocka_unit_test(every_kind_of_value_is_read),
        cmocka_unit_test(odd_but_valid_files_are_read),
        cmocka_unit_test(bad_files_are_refused_by_line_and_reason),
        cmocka_unit_test(files_that_are_no_text_are_refused),
        cmocka_unit_test(rules_between_settings_hold_for_all_of_them_together),
        cmocka_unit_test(set_changes_one_value_or_nothing),
        cmocka_unit_test(print_reads_back_to_the_same_bits),
        cmocka_unit_test(decimal_comma_of_the_locale_changes_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
