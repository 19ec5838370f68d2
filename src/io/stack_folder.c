#include "io/stack.h"

/* A file has slices and frames: whole frames, that is. */
static int has_frames(const struct v2v_stack *stack)
{
    return stack->axes.channels > 1 || (stack->axes.slices > 1 && stack->axes.frames > 1);
}

static enum v2v_status decide(enum v2v_layout *layout, const struct v2v_stack *stack, int64_t views)
{
    const long long files = stack->files, pages = stack->pages_of_file;
    if (views == 0) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: has %lld files of %lld pages: --views V, or --layout views (a file a "
                        "view) or frames (files of whole frames), says how to read them",
                        stack->path, files, pages);
    }
    const int fits_views = files == views && !has_frames(stack);
    const int fits_frames = pages % views == 0;
    if (fits_views && fits_frames && views > 1) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: its %lld files of %lld pages can be %lld views or frames of %lld "
                        "views: --layout views or --layout frames",
                        stack->path, files, pages, (long long)views, (long long)views);
    }
    if (!fits_views && !fits_frames) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: its %lld files of %lld pages are neither %lld views nor frames of "
                        "%lld views%s",
                        stack->path, files, pages, (long long)views, (long long)views,
                        pages == 1 && files % views == 0
                            ? "; --layout frames takes one page after the other"
                            : "");
    }
    *layout = fits_frames ? V2V_LAYOUT_FRAMES : V2V_LAYOUT_VIEWS;
    return V2V_OK;
}

enum v2v_status v2v_stack_lay_out_folder(struct v2v_stack *stack,
                                         const struct v2v_input_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_stack_axes *axes = &stack->axes;
    enum v2v_layout layout = (enum v2v_layout)settings->layout;
    const int64_t files = stack->files, pages = stack->pages_of_file;
    if (layout == V2V_LAYOUT_AUTO) {
        V2V_TRY(decide(&layout, stack, settings->views));
    }
    stack->by_view = layout == V2V_LAYOUT_VIEWS;
    if (stack->by_view && has_frames(stack)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: its files have %lld channels, %lld slices and %lld frames: none is a "
                         "view%s",
                         stack->path, (long long)axes->channels, (long long)axes->slices,
                         (long long)axes->frames,
                         axes->channels > 1 ? "; --channel K (from 1) takes one channel" : ""));
    }
    if (stack->by_view && settings->views > 0 && settings->views != files) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: has %lld files, but %lld views are asked for",
                         stack->path, (long long)files, (long long)settings->views));
    }
    if (stack->by_view) {
        *axes = (struct v2v_stack_axes){1, files, pages};
    } else if (has_frames(stack)) {
        axes->frames *= files;
    } else if (settings->views == 0 || settings->views == pages) { /* a file is a frame */
        *axes = (struct v2v_stack_axes){1, pages, files};
    } else {
        *axes = (struct v2v_stack_axes){1, 1, files * pages};
    }
done:
    return rc;
}
