#ifndef V2V_CLI_PROCESSOR_H
#define V2V_CLI_PROCESSOR_H

/** The processor as the kernel tells it. */
struct v2v_processor {
    char model[128];        /**< "unknown processor" where it is not told */
    char instructions[128]; /**< the sets that decide the speed: "avx2 fma avx512f" */
};

/** @kind Local */
void v2v_cli_processor(struct v2v_processor *processor);

#endif
