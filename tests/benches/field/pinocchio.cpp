// Peer of the estimator and of the simulator: Pinocchio with Eigen. pinocchio ARM DATA ROWS WORK JOINT... (ARM: of arm.py): nanoseconds of the processor an instant,
// and the sum of the last wrench (of all torques for `rnea`), for WORK of
//   rnea      inverse dynamics alone
//   wrench    inverse dynamics, the gauges' rows, one unweighted QR
//   resting   gravity load, the gauges' rows, one QR weighed by the gauges' own noise, covariance: what an arm at rest needs at least
//   weighed   what the estimator does, as far as these libraries have a call for it: derivatives of the dynamics give the motion's share of
//             the gauges' covariance; whitening, QR, covariance, singular values, twice
// DATA: 16 numbers a gauge (6 compliance, bias, variance, and 8 unused), then ROWS of q, v, a, readings; as many gauges as joints.
// As Pinocchio's own build system has them.
#define BOOST_MPL_LIMIT_LIST_SIZE 30
#define BOOST_MPL_LIMIT_VECTOR_SIZE 30
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS
#define BOOST_FUSION_INVOKE_MAX_ARITY 12
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <Eigen/Dense>
#include <ctime>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

constexpr int N = 8, HEAD = 16;
constexpr double SIGMA[3] = {2e-5, 1e-3, 1e-1};
using Rows = Eigen::Matrix<double, N, 6>;
using Counts = Eigen::Matrix<double, N, 1>;

struct Arm {
    pinocchio::Model model;
    pinocchio::Data data;
    pinocchio::SE3 tip_in_last;
    std::vector<int> joints;  // of each gauge
    Eigen::Matrix<double, N, 6, Eigen::RowMajor> compliance;
    Counts bias, variance;
    Rows rows;
    Counts values;
};

// Rows and values; the joints' forces must be known.
static void collect(Arm& arm, const double* z) {
    pinocchio::SE3 to_tip[N + 1];
    pinocchio::SE3 placed = arm.tip_in_last;
    for (int joint = N; joint > 0; --joint) {
        to_tip[joint] = placed;
        placed = arm.data.liMi[joint] * placed;
    }
    for (int gauge = 0; gauge < N; ++gauge) {
        const int joint = arm.joints[gauge];
        arm.rows.row(gauge).noalias() = arm.compliance.row(gauge) * to_tip[joint].toDualActionMatrix();
        arm.values(gauge) = z[gauge] - arm.bias(gauge) + arm.compliance.row(gauge).dot(arm.data.f[joint].toVector());
    }
}

static Eigen::Matrix<double, 6, 6> covariance_of(const Eigen::HouseholderQR<Rows>& qr) {
    const Eigen::Matrix<double, 6, 6> r = qr.matrixQR().topRows<6>().triangularView<Eigen::Upper>();
    const Eigen::Matrix<double, 6, 6> inverse =
        r.triangularView<Eigen::Upper>().solve(Eigen::Matrix<double, 6, 6>::Identity());
    return inverse * inverse.transpose();
}

static Eigen::Matrix<double, 6, 1> resting(const Arm& arm, const Counts& weights, Eigen::Matrix<double, 6, 6>& covariance) {
    const Eigen::HouseholderQR<Rows> qr(weights.asDiagonal() * arm.rows);
    covariance = covariance_of(qr);
    return qr.solve(weights.asDiagonal() * arm.values);
}

static Eigen::Matrix<double, 6, 1> weighed(Arm& arm, Eigen::Matrix<double, 6, 6>& covariance, double& worst) {
    Eigen::Matrix<double, N, N> noise = arm.variance.asDiagonal();
    const Eigen::Matrix<double, N, N> parts[3] = {arm.data.dtau_dq, arm.data.dtau_dv, arm.data.M};
    Eigen::Matrix<double, N, N> share;
    for (int part = 0; part < 3; ++part) {
        for (int gauge = 0; gauge < N; ++gauge)
            share.row(gauge) = (arm.compliance(gauge, 5) * SIGMA[part]) * parts[part].row(arm.joints[gauge] - 1);
        noise.noalias() += share * share.transpose();
    }
    const Eigen::LLT<Eigen::Matrix<double, N, N>> root(noise);
    const Rows a = root.matrixL().solve(arm.rows);
    const Counts b = root.matrixL().solve(arm.values);
    const Eigen::HouseholderQR<Rows> qr(a);
    covariance = covariance_of(qr);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> squares(covariance, Eigen::EigenvaluesOnly);
    worst += squares.eigenvalues()(5);
    return qr.solve(b);
}

template <int ROWS, int COLUMNS>
static Eigen::Matrix<double, ROWS, COLUMNS> read(std::istream& from) {
    Eigen::Matrix<double, ROWS, COLUMNS> matrix;
    for (int row = 0; row < ROWS; ++row)
        for (int column = 0; column < COLUMNS; ++column) from >> matrix(row, column);
    return matrix;
}

static pinocchio::SE3 read_placement(std::istream& from) {
    const auto rotation = read<3, 3>(from);
    return pinocchio::SE3(rotation, read<3, 1>(from));
}

static void read_arm(std::istream& from, Arm& arm) {
    int joints = 0;
    from >> joints;
    for (int joint = 0; joint < joints; ++joint) {
        std::string name;
        double mass = 0;
        from >> name >> mass;
        const auto placement = read_placement(from);
        const Eigen::Vector3d lever = read<3, 1>(from);
        const pinocchio::Inertia body(mass, lever, pinocchio::Symmetric3(read<3, 3>(from)));
        arm.model.addJoint(joint, pinocchio::JointModelRZ(), placement, name);
        arm.model.appendBodyToJoint(joint + 1, body, pinocchio::SE3::Identity());
    }
    arm.tip_in_last = read_placement(from);
    arm.model.gravity.linear() = Eigen::Vector3d(0, 0, -9.80665);
    arm.data = pinocchio::Data(arm.model);
}

int main(int argc, char** argv) {
    if (argc != 5 + N) return 2;
    const long rows = std::atol(argv[3]);
    const std::string work = argv[4];
    Arm arm;
    std::ifstream from(argv[1]);
    read_arm(from, arm);
    if (!from || arm.model.nv != N) return std::fprintf(stderr, "no arm of %d joints in %s\n", N, argv[1]), 1;
    for (int gauge = 0; gauge < N; ++gauge) arm.joints.push_back(int(arm.model.getJointId(argv[5 + gauge])));
    std::vector<double> all(HEAD * N + rows * 4 * N);
    FILE* file = std::fopen(argv[2], "rb");
    if (!file || std::fread(all.data(), sizeof(double), all.size(), file) != all.size()) return 1;
    std::fclose(file);
    for (int gauge = 0; gauge < N; ++gauge) {
        for (int k = 0; k < 6; ++k) arm.compliance(gauge, k) = all[HEAD * gauge + k];
        arm.bias(gauge) = all[HEAD * gauge + 6];
        arm.variance(gauge) = all[HEAD * gauge + 7];
    }
    // Numbers a joint in DATA are in the order of the gauges; here in that of the model.
    auto placed = [&](const double* from, Eigen::VectorXd& to) {
        for (int gauge = 0; gauge < N; ++gauge) to(arm.joints[gauge] - 1) = from[gauge];
    };
    Eigen::VectorXd q(N), v(N), a(N);
    Eigen::Matrix<double, 6, 6> covariance;
    const Counts weights = arm.variance.cwiseSqrt().cwiseInverse();
    double sum = 0, worst = 0;
    const std::clock_t begun = std::clock();
    for (long row = 0; row < rows; ++row) {
        const double* at = &all[HEAD * N + row * 4 * N];
        placed(at, q), placed(at + N, v), placed(at + 2 * N, a);
        if (work == "rnea") {
            sum += pinocchio::rnea(arm.model, arm.data, q, v, a).sum();
            continue;
        }
        Eigen::Matrix<double, 6, 1> wrench;
        if (work == "wrench") {
            pinocchio::rnea(arm.model, arm.data, q, v, a);
            collect(arm, at + 3 * N);
            wrench = arm.rows.householderQr().solve(arm.values);
        } else if (work == "resting") {
            pinocchio::computeGeneralizedGravity(arm.model, arm.data, q);
            collect(arm, at + 3 * N);
            wrench = resting(arm, weights, covariance);
            worst += covariance(0, 0);
        } else {
            pinocchio::computeRNEADerivatives(arm.model, arm.data, q, v, a);
            for (int joint = 1; joint <= N; ++joint) arm.data.f[joint] = arm.data.oMi[joint].actInv(arm.data.of[joint]);
            collect(arm, at + 3 * N);
            weighed(arm, covariance, worst);
            wrench = weighed(arm, covariance, worst);
        }
        if (row + 1 == rows) sum = wrench.sum();
    }
    std::printf("%.9g %.17g\n", double(std::clock() - begun) / CLOCKS_PER_SEC * 1e9 / rows, sum);
    return worst < 0;
}
