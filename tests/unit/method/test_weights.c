/* Weights of every network, out of files of this program and of others. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/arrays.h"
#include "v2v3d/io/file.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/method/weights.h"
#include "v2v3d/nn/rule.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 4 };

static char path[512], other[512];
static struct v2v_config config;

/* Sizes that no default has. */
static int configure(void **state)
{
    (void)state;
    v2v_config_defaults(&config);
    config.model.width = 3;
    config.model.features = 2;
    config.model.volume_scale = 0.1;
    config.backconv.width = 6;
    config.vcdnet.width = 3;
    config.vcdnet.levels = 2;
    config.deepcad.width = 2;
    config.deepcad.levels = 3;
    config.synthesis.width = 2;
    config.synthesis.levels = 2;
    return 0;
}

static void use(const char *name)
{
    snprintf(path, sizeof path, "%s/%s", test_folder(NULL), name);
    snprintf(other, sizeof other, "%s/other-%s", test_folder(NULL), name);
}

/* Weights of a network that was trained for three steps. */
static struct v2v_weights make(const char *method)
{
    struct v2v_weights made = {.is_ours = 1};
    const struct v2v_network_spec spec = {
        .config = &config, .views = VIEWS, .slices = SLICES, .outputs = V2V_NETWORK_ALL};
    snprintf(config.model.method, sizeof config.model.method, "%s", method);
    assert_ok(v2v_network_describe(&made.info, &config, VIEWS, SLICES, 3));
    made.info.levels.frames = 7;
    for (int f = 0; f < V2V_LEVEL_FIGURES; f++) {
        made.info.levels.least[f] = 0.1 * (f + 1);
        made.info.levels.most[f] = 0.3 * (f + 1);
    }
    assert_ok(v2v_network_schema(&made.schema, method, &spec));
    assert_ok(V2V_ALLOC(made.arena, "test", made.schema.fields.total));
    assert_ok(v2v_rule_weights(&made.schema.fields, made.arena, V2V_RULE_HE, 7));
    assert_ok(V2V_ALLOC(made.config, "test", 64));
    snprintf(made.config, 64, "train:\n  steps: 3 # \xc2\xb5m \"\n");
    return made;
}

static void assert_same_numbers(const struct v2v_weights *a, const struct v2v_weights *b)
{
    assert_int_equal(a->schema.fields.total, b->schema.fields.total);
    assert_memory_equal(a->arena, b->arena, (size_t)a->schema.fields.total * sizeof *a->arena);
}

/* With another configuration than the file's: it is the file's that counts. */
static struct v2v_weights_hints no_hints(void)
{
    static struct v2v_config defaults;
    v2v_config_defaults(&defaults);
    return (struct v2v_weights_hints){.config = &defaults};
}

static void weights_go_through_both_formats_and_back(void **state)
{
    (void)state;
    const struct v2v_weights_hints hints = no_hints();
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        struct v2v_weights made = make(v2v_network_at(i)->name), safe, hdf5;
        use("w.safetensors");
        assert_ok(v2v_weights_write(&made, path, 1));
        assert_true(v2v_file_is_safetensors(path));
        assert_ok(v2v_weights_read(&safe, path, &hints));
        assert_ok(v2v_weights_write(&safe, other, 1));
        assert_same_bytes(path, other);
        use("w.h5");
        assert_ok(v2v_weights_write(&safe, path, 0));
        assert_ok(v2v_weights_read(&hdf5, path, &hints));
        const struct v2v_weights *found[] = {&safe, &hdf5};
        for (int f = 0; f < 2; f++) {
            assert_true(found[f]->is_ours);
            assert_memory_equal(&found[f]->info, &made.info, sizeof made.info);
            assert_string_equal(found[f]->config, made.config);
            assert_same_numbers(found[f], &made);
        }
        v2v_weights_fini(&made);
        v2v_weights_fini(&safe);
        v2v_weights_fini(&hdf5);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

/* A stranger's file: the arrays of `made` under `prefix`, in the reverse order, but for array
 * `left_out`; with one more where `more` is its header's text. */
static void write_plain(const struct v2v_weights *made, const char *prefix, int64_t left_out,
                        const char *more)
{
    static char header[1 << 16];
    const struct v2v_fields *fields = &made->schema.fields;
    size_t used = (size_t)snprintf(header, sizeof header, "{%s", more);
    int64_t first = 0;
    unsigned char length[8] = {0};
    for (int64_t i = fields->count - 1; i >= 0; i--) {
        const struct v2v_fields_item *field = &fields->item[i];
        const int64_t bytes = field->count * (int64_t)sizeof(float);
        if (i == left_out) {
            continue;
        }
        used += (size_t)snprintf(header + used, sizeof header - used,
                                 "%s\"%s%s\":{\"dtype\":\"F32\",\"shape\":[", first > 0 ? "," : "",
                                 prefix, field->name);
        for (int a = 0; a < field->rank; a++) {
            used += (size_t)snprintf(header + used, sizeof header - used, "%s%lld",
                                     a > 0 ? "," : "", (long long)field->shape[a]);
        }
        used +=
            (size_t)snprintf(header + used, sizeof header - used, "],\"data_offsets\":[%lld,%lld]}",
                             (long long)first, (long long)(first + bytes));
        first += bytes;
    }
    used += (size_t)snprintf(header + used, sizeof header - used, "}");
    assert_true(used < sizeof header);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    for (int i = 0; i < 8; i++) {
        length[i] = (unsigned char)(used >> 8 * i);
    }
    fwrite(length, 1, sizeof length, file);
    fwrite(header, 1, used, file);
    for (int64_t i = fields->count - 1; i >= 0; i--) {
        const struct v2v_fields_item *field = &fields->item[i];
        if (i != left_out) {
            fwrite(made->arena + field->offset, sizeof *made->arena, (size_t)field->count, file);
        }
    }
    assert_int_equal(fclose(file), 0);
}

static void a_strangers_file_is_known_by_names_and_shapes(void **state)
{
    (void)state;
    static const char *const prefixes[] = {"", "module.", "_orig_mod.module."};
    struct v2v_weights_hints hints = no_hints();
    use("plain.safetensors");
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        const char *method = v2v_network_at(i)->name;
        struct v2v_weights made = make(method), found;
        /* what shapes tell */
        hints.views = strcmp(method, "v2v") == 0 || strcmp(method, "vcdnet") == 0 ? 0 : VIEWS;
        hints.slices = v2v_network_at(i)->traits & V2V_TRAIT_ANY ? SLICES : 0;
        for (int p = 0; p < 3; p++) {
            write_plain(&made, prefixes[p], -1, "");
            assert_string_equal(v2v_weights_method(path, hints.config), method);
            assert_ok(v2v_weights_read(&found, path, &hints));
            assert_false(found.is_ours);
            assert_string_equal(found.info.method, method);
            assert_true(found.info.views == VIEWS && found.info.slices == SLICES &&
                        found.info.step == 0 && found.info.levels.frames == 0);
            assert_string_equal(found.info.split, made.info.split);
            assert_same_numbers(&found, &made);
            v2v_weights_fini(&found);
        }
        v2v_weights_fini(&made);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void assert_refused(enum v2v_status code, const char *says)
{
    struct v2v_weights found;
    const struct v2v_weights_hints hints = no_hints();
    assert_int_equal(v2v_weights_read(&found, path, &hints), code);
    if (strstr(v2v_status_message(), says) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", v2v_status_message(), says);
    }
    v2v_weights_fini(&found);
}

static void arrays_that_do_not_fit_are_named_with_both_shapes(void **state)
{
    (void)state;
    struct v2v_weights made = make("v2v");
    struct v2v_fields_item *last = &made.schema.fields.item[made.schema.fields.count - 1];
    use("plain.safetensors");
    write_plain(&made, "", made.schema.fields.count - 1, "");
    assert_refused(V2V_E_INPUT,
                   "unet2.conv_final.4.bias: is missing; the network 'v2v' needs it, [4]");
    write_plain(&made, "", -1,
                "\"unet3.x\":{\"dtype\":\"I64\",\"shape\":[0,2],\"data_offsets\":[0,0]},");
    assert_refused(V2V_E_INPUT, "unet3.x: [0,2] is no array of the network 'v2v'");
    last->rank = 2;
    last->shape[1] = 1;
    write_plain(&made, "", -1, "");
    assert_refused(V2V_E_INPUT,
                   "unet2.conv_final.4.bias: is [4,1], not [4], which 'v2v' of 5 views "
                   "and 4 slices needs");
    snprintf(last->name, sizeof last->name, "unet2.conv_final.4.bia");
    last->rank = 1;
    write_plain(&made, "", -1, "");
    assert_refused(V2V_E_INPUT, "unet2.conv_final.4.bias: is missing");
    v2v_weights_fini(&made);
    made = make("backconv");
    write_plain(&made, "", -1, "");
    assert_refused(V2V_E_USAGE, "do not tell its views: give --views");
    v2v_weights_fini(&made);
    made = make("unrolled");
    snprintf(made.schema.fields.item[0].name, 8, "d1");
    write_plain(&made, "", -1, "");
    assert_refused(V2V_E_USAGE, "do not tell its views");
    v2v_weights_fini(&made);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    fwrite("\2\0\0\0\0\0\0\0{}", 1, 10, file);
    assert_int_equal(fclose(file), 0);
    assert_refused(V2V_E_INPUT, "none of its 0 arrays is of a network");
    assert_null(v2v_weights_method(path, &config));
    assert_int_equal(v2v_mem_held(), 0);
}

/* Every third bit of a file of this program, one after the other: nothing crashes, and numbers that
 * differ are never called read. */
static void no_flipped_bit_changes_a_number(void **state)
{
    (void)state;
    enum { MOST = 1 << 18, EVERY = 3 };
    static char content[MOST];
    const struct v2v_weights_hints hints = no_hints();
    struct v2v_weights made, found;
    int64_t refused = 0, read = 0;
    config.backconv.width = 1;
    made = make("backconv");
    use("w.safetensors");
    assert_ok(v2v_weights_write(&made, path, 1));
    FILE *file = fopen(path, "r+b");
    assert_non_null(file);
    const size_t bytes = fread(content, 1, MOST, file);
    assert_true(bytes > 8 && bytes < MOST);
    for (size_t bit = 0; bit < 8 * bytes; bit += EVERY) {
        const char flipped = (char)(content[bit / 8] ^ 1 << bit % 8);
        assert_int_equal(fseek(file, (long)(bit / 8), SEEK_SET), 0);
        assert_true(fwrite(&flipped, 1, 1, file) == 1 && fflush(file) == 0);
        const enum v2v_status rc = v2v_weights_read(&found, path, &hints);
        if (rc == V2V_OK) {
            assert_same_numbers(&found, &made);
            read++;
        } else {
            assert_true(rc == V2V_E_INPUT || rc == V2V_E_USAGE);
            refused++;
        }
        v2v_weights_fini(&found);
        assert_int_equal(fseek(file, (long)(bit / 8), SEEK_SET), 0);
        assert_true(fwrite(content + bit / 8, 1, 1, file) == 1 && fflush(file) == 0);
    }
    assert_int_equal(fclose(file), 0);
    print_message("%lld flips refused, %lld without effect on numbers\n", (long long)refused,
                  (long long)read);
    assert_true(refused > 100 && read > 100);
    v2v_weights_fini(&made);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(weights_go_through_both_formats_and_back),
        cmocka_unit_test(a_strangers_file_is_known_by_names_and_shapes),
        cmocka_unit_test(arrays_that_do_not_fit_are_named_with_both_shapes),
        cmocka_unit_test(no_flipped_bit_changes_a_number),
    };
    return cmocka_run_group_tests_name("weights", tests, configure, NULL);
}
