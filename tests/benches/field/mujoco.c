// Peer of the simulator: MuJoCo's inverse dynamics. mujoco URDF DATA ROWS JOINT...: nanoseconds of the processor an instant, and the sum of all torques.
// DATA as that of pinocchio.cpp.
#include <mujoco/mujoco.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { N = 8, HEAD = 16 };

int main(int argc, char** argv) {
    if (argc != 4 + N) return 2;
    char error[1000] = "";
    mjModel* model = mj_loadXML(argv[1], NULL, error, sizeof error);
    if (!model || model->nv != N) return fprintf(stderr, "%s\n", error), 1;
    model->opt.gravity[2] = -9.80665;
    const long rows = atol(argv[3]);
    const size_t count = HEAD * N + rows * 4 * N;
    double* all = malloc(count * sizeof *all);
    FILE* file = fopen(argv[2], "rb");
    if (!all || !file || fread(all, sizeof *all, count, file) != count) return 1;
    int joints[N];
    for (int k = 0; k < N; ++k) {
        const int joint = mj_name2id(model, mjOBJ_JOINT, argv[4 + k]);
        if (joint < 0) return 1;
        joints[k] = model->jnt_dofadr[joint];
    }
    mjData* data = mj_makeData(model);
    double sum = 0;
    struct timespec begun, ended;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &begun);
    for (long row = 0; row < rows; ++row) {
        const double* at = all + HEAD * N + row * 4 * N;
        for (int k = 0; k < N; ++k) {
            data->qpos[joints[k]] = at[k];
            data->qvel[joints[k]] = at[N + k];
            data->qacc[joints[k]] = at[2 * N + k];
        }
        mj_inverse(model, data);
        for (int k = 0; k < N; ++k) sum += data->qfrc_inverse[k];
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &ended);
    printf("%.9g %.17g\n", ((ended.tv_sec - begun.tv_sec) * 1e9 + (ended.tv_nsec - begun.tv_nsec)) / rows, sum);
}
