/** poke FILE DATASET ELEMENT VALUE: one element, counted from 0 over the whole dataset, becomes
 *  VALUE (nan, too); nothing else of the HDF5 file changes. */
#include <hdf5.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    hsize_t extent[H5S_MAX_RANK], place[H5S_MAX_RANK];
    const hsize_t one = 1;
    if (argc != 5) {
        return 2;
    }
    hid_t file = H5Fopen(argv[1], H5F_ACC_RDWR, H5P_DEFAULT);
    hid_t set = H5Dopen2(file, argv[2], H5P_DEFAULT);
    hid_t space = H5Dget_space(set);
    hid_t memory = H5Screate_simple(1, &one, NULL);
    const int rank = H5Sget_simple_extent_dims(space, extent, NULL);
    hsize_t left = strtoull(argv[3], NULL, 10);
    const double value = strtod(argv[4], NULL);
    for (int i = rank - 1; i >= 0; i--) {
        place[i] = left % extent[i];
        left /= extent[i];
    }
    if (rank < 1 || left != 0 || H5Sselect_elements(space, H5S_SELECT_SET, 1, place) < 0 ||
        H5Dwrite(set, H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT, &value) < 0) {
        fprintf(stderr, "poke: %s: %s: element %s cannot be written\n", argv[1], argv[2], argv[3]);
        return 1;
    }
    H5Sclose(memory);
    H5Sclose(space);
    H5Dclose(set);
    return H5Fclose(file) < 0;
}
