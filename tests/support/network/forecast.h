/** How long training and reconstruction take on ranks that are not there.
 *
 *  Purpose: from what one machine was measured to do (v2v_forecast_measure) and from what the
 *  network has to compute and to move, the time of a training step or of a recording over any
 *  number of ranks and hosts, and what it is spent on. Invariants: the parts add up to the whole;
 *  the grid is the one that the run would choose; nothing here was fitted to scaling runs.
 *
 *  The model: a rank takes the multiply-adds of its rows, branches and rounds at the measured rate,
 *  slower where a host's cores all compute and slower again where they are fewer than threads. What
 *  ranks of a host send each other is copied by their cores and hidden behind nothing. What crosses
 *  hosts goes through one link a host, which its ranks share: gradients travel behind the backward
 *  pass, layer by layer, and cost what is not there when it ends; everything else is waited for.
 *  Files are written and read at one rate, however many ranks do.
 *
 *  Example (compiled by tests/unit/v2v):
 *
 *      struct v2v_forecast_job job = {.network = &network, .items = 100, .height = 512,
 *                                     .width = 512};
 *      V2V_TRY(v2v_forecast_network_of(&network, &spec, &shifts));
 *      V2V_TRY(v2v_forecast(&result, &machine, &job, 64, 32));
 *  done:
 *      return rc;
 */
#ifndef V2V_TEST_FORECAST_H
#define V2V_TEST_FORECAST_H

#include "v2v3d/optics/shifts.h"
#include "v2v3d/par/cost.h"
#include "v2v3d/v2v/model.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { V2V_FORECAST_LAYERS = 24, V2V_FORECAST_BRANCHES = 2 };

/** Forward passes that a training step takes, losses and Adam included: measured at width 128 on
 *  128 x 128 (2.9 to 3.3). Three of them are the network's, which slabs share. */
#define V2V_FORECAST_STEP_PASSES 3.2

/** One kind of host, and a rank on it. */
struct v2v_forecast_machine {
    int cores;          /**< of a host */
    int threads;        /**< of a rank */
    double mac_s;       /**< a multiply-add of the forward pass, the host's other cores idle */
    double crowd;       /**< >= 1: how many times as long while all cores of the host compute */
    double file_byte_s; /**< read or written, by all ranks together */
    struct v2v_comm_cost inside; /**< of a host */
    double link_byte_s;          /**< that a host sends to others */
    double link_message_s;       /**< until a message is at another host */
};

/** A layer of a U-Net. */
struct v2v_forecast_layer {
    double macs;  /**< multiply-adds a pixel of the frame */
    double bytes; /**< of its gradients */
};

/** What the network computes and what its parts weigh. */
struct v2v_forecast_network {
    struct v2v_model_spec spec;
    double view_macs;     /**< of the encoder for a view, a pixel of the frame */
    double encoder_bytes; /**< of its gradients */
    struct {
        int64_t views;
        double cut_macs;   /**< of layers of full and half size, a pixel of the frame */
        double whole_macs; /**< of the rest, which no slabs share */
        struct v2v_forecast_layer layer[V2V_FORECAST_LAYERS]; /**< as backward takes them */
    } branch[V2V_FORECAST_BRANCHES];
    int layers;
};

/** A step, or a recording. */
struct v2v_forecast_job {
    const struct v2v_forecast_network *network;
    int training;          /**< 1: a step on a batch of crops; 0: frames to reconstruct */
    int64_t items;         /**< samples or frames */
    int64_t height, width; /**< of each */
};

/** Seconds, and what they are made of. */
struct v2v_forecast {
    int ranks, hosts;
    int data, idle; /**< ranks side by side, and without work */
    struct v2v_grid_shape shape;
    int64_t rounds;
    double compute_s;  /**< the work shared evenly by all ranks, each at the speed it has alone */
    double crowded_s;  /**< hosts whose cores all compute, or are fewer than threads */
    double repeated_s; /**< what several ranks compute alike: margins, small layers, losses */
    double uneven_s;   /**< ranks without work: items are no multiple of them */
    double network_s;
    double file_s;
    double seconds; /**< their sum */
};

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_forecast_network_of(struct v2v_forecast_network *network,
                                        const struct v2v_model_spec *spec,
                                        const struct v2v_shifts *shifts) V2V_MUST_CHECK;

/** Multiply-adds of a forward pass over a frame of [height,width]. @kind Local. */
double v2v_forecast_macs(const struct v2v_forecast_network *network, int64_t height, int64_t width);

/** The job over `ranks` ranks, as many on each of `hosts` hosts. Training takes the number of slabs
 *  (parallel.slabs) that ends first. @kind Local. @return V2V_OK */
enum v2v_status v2v_forecast(struct v2v_forecast *forecast,
                             const struct v2v_forecast_machine *machine,
                             const struct v2v_forecast_job *job, int ranks,
                             int hosts) V2V_MUST_CHECK;

/** How a machine's figures came about. */
struct v2v_forecast_speed {
    int64_t side;         /**< of the frame */
    double alone_s;       /**< a forward pass of one rank */
    double together_s;    /**< of the slowest rank while all compute */
    int is_link_measured; /**< else link_byte_s and link_message_s are as they were given */
};

/** Fill in the machine's threads, mac_s, crowd and inside: the network with weights by rule over a
 *  frame of `side` x `side` pixels, on one rank and on all at once, the median of three passes
 * each. crowd is 1 where a host has one rank. The link is measured where the ranks are on several
 * hosts. All ranks get the same figures.
 *  @kind Collective(world). @param host the ranks of this rank's host
 *  @return V2V_OK | V2V_E_MEMORY | V2V_E_INTERNAL; agreed */
enum v2v_status v2v_forecast_measure(struct v2v_forecast_machine *machine,
                                     struct v2v_forecast_speed *speed,
                                     const struct v2v_forecast_network *network,
                                     const struct v2v_shifts *shifts, int64_t side,
                                     const struct v2v_comm *host,
                                     const struct v2v_comm *world) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
