#ifndef V2V3D_SIM_DATASET_H
#define V2V3D_SIM_DATASET_H

#include "v2v3d/sim/recording.h"

#ifdef __cplusplus
extern "C" {
#endif

/** A folder of scenes, each with its recording:
 *      FOLDER/dataset.json                         the settings, one line
 *      FOLDER/PART/NNNNNN_truth.h5                 the volume
 *      FOLDER/PART/NNNNNN_clean.h5, .._noisy.h5    one frame of its views, without and with noise
 *  PART is train, validation where N mod 10 is 8, test where it is 9: the same for any count. Scene
 *  N is what `simulate` draws with the seed 1000000 * seed + N, of the kind (N + N / 10) mod
 *  kind_count: so each part has all of up to ten kinds. */
struct v2v_dataset {
    const char *folder;
    int64_t count; /**< of scenes, up to a million */
    int64_t seed;  /**< 0 .. 1e9 */
    const int *kinds;
    int64_t kind_count;
    struct v2v_scene scene;           /**< size and voxels; its kind and seed are not looked at */
    struct v2v_simulation simulation; /**< noise and what to state, likewise */
    const char *noise;                /**< as it was written, for the settings */
    int resume;                       /**< keep the scenes that are complete */
    int force;                        /**< or remove all of them first */
};

/** What was done. */
struct v2v_dataset_report {
    int64_t made, kept; /**< scenes, of all ranks */
    double seconds;
};

/** Make the scenes that are missing. Ranks make different scenes, each alone, and agree after each
 *  round; a signal (base/stop.h) ends it after the round. Files get their names when complete, a
 *  scene's noisy views last. A failure before the first scene is complete leaves the folder as it
 *  was, but for what force removed.
 *  @kind Collective(comm). @param psf as configured; every rank holds it
 *  @return V2V_OK | V2V_STOPPED (resumable) | V2V_E_USAGE (the folder holds a data set, without
 *  resume or force; of other settings; scenes without settings) | V2V_E_BUSY (another run makes it)
 *  | V2V_E_INPUT (a scene too dark) | V2V_E_IO | V2V_E_MEMORY; agreed
 *  @cost a scene: a projection of all views on one rank */
enum v2v_status v2v_dataset_make(struct v2v_dataset_report *report,
                                 const struct v2v_dataset *dataset, const struct v2v_psf_file *psf,
                                 const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
