/* What a processor does that announces instructions and does not know them. */
#include <signal.h>

void DYING(void);

void DYING(void)
{
    raise(SIGILL);
}
