#include "optics/zernike.h"

#include "v2v3d/base/text.h"
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum v2v_status v2v_zernike_parse(struct v2v_zernike *zernike, const char *text)
{
    enum v2v_status rc = V2V_OK;
    uint8_t given[V2V_ZERNIKE_MOST + 1] = {0};
    *zernike = (struct v2v_zernike){0};
    while (text[strspn(text, " ,")] != '\0') {
        char mode[32] = "", waves[32] = "";
        int read = 0;
        int64_t j = 0;
        text += strspn(text, " ,");
        if (sscanf(text, "%31[0-9]:%31[0-9eE.+-]%n", mode, waves, &read) != 2 || read == 0) {
            V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "optics.zernike: '%s' does not begin with MODE:WAVES",
                             text));
        }
        V2V_TRY(v2v_text_to_i64(&j, mode, 1, V2V_ZERNIKE_MOST, "optics.zernike, Noll's index",
                                V2V_E_CONFIG));
        if (given[j]) {
            V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "optics.zernike: mode %" PRId64 " is given twice", j));
        }
        given[j] = 1;
        V2V_TRY(v2v_text_to_f64(&zernike->waves[j], waves, -100.0, 100.0, "optics.zernike, waves",
                                V2V_E_CONFIG));
        zernike->last = j > zernike->last && zernike->waves[j] != 0.0 ? j : zernike->last;
        text += read;
    }
done:
    return rc;
}

enum v2v_status v2v_zernike_print(char *text, size_t bytes, const struct v2v_zernike *zernike)
{
    size_t used = 0;
    text[0] = '\0';
    for (int j = 1; j <= zernike->last; j++) {
        if (zernike->waves[j] != 0.0) {
            used += (size_t)snprintf(text + used, bytes - used, "%s%d:%.6g", used > 0 ? ", " : "",
                                     j, zernike->waves[j]);
        }
        if (used >= bytes) {
            return V2V_FAIL(V2V_E_CONFIG, "optics.zernike: more than %zu letters", bytes - 1);
        }
    }
    return V2V_OK;
}

/* R(n,m) = r^m * sum over k of c_k (r^2)^((n-m)/2-k), c_0 = n over (n-m)/2, and each c_k from the
 * one before. */
static double radial(int n, int m, double r)
{
    const int few = (n - m) / 2, many = (n + m) / 2;
    double c = 1.0, sum = 0.0;
    for (int k = 1; k <= few; k++) {
        c *= (double)(many + k) / k;
    }
    for (int k = 0; k <= few; k++) {
        sum = sum * r * r + c;
        c *= -(double)(many - k) * (few - k) / ((k + 1.0) * (n - k));
    }
    return sum * pow(r, m);
}

/* Noll counts by radial order n, in it by azimuthal order m; even indices are cosines. */
static double mode_at(int64_t j, double r, double azimuth)
{
    int n = 0;
    while ((n + 1) * (n + 2) / 2 < j) {
        n++;
    }
    const int place = (int)j - n * (n + 1) / 2 - 1; /* 0 .. n within the order */
    const int m = n % 2 == 0 ? (place + 1) / 2 * 2 : place / 2 * 2 + 1;
    if (m == 0) {
        return sqrt(n + 1.0) * radial(n, 0, r);
    }
    const double angular = j % 2 == 0 ? cos(m * azimuth) : sin(m * azimuth);
    return sqrt(2.0 * (n + 1.0)) * radial(n, m, r) * angular;
}

double v2v_zernike_at(const struct v2v_zernike *zernike, double y, double x)
{
    double sum = 0.0;
    for (int64_t j = 1; j <= zernike->last; j++) {
        if (zernike->waves[j] != 0.0) {
            sum += zernike->waves[j] * mode_at(j, hypot(y, x), atan2(y, x));
        }
    }
    return sum;
}
