// Peer of the linear stage: Eigen's Householder QR. eigen_qr FILE ROWS COLUMNS GAUGES: seconds for as many least squares.
#include <Eigen/Dense>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

int main(int argc, char** argv) {
    if (argc != 5) return 2;
    const long rows = std::atol(argv[2]), columns = std::atol(argv[3]), gauges = std::atol(argv[4]);
    std::vector<double> raw(rows * (columns + 1));
    FILE* file = std::fopen(argv[1], "rb");
    if (!file || std::fread(raw.data(), sizeof(double), raw.size(), file) != raw.size()) return 1;
    std::fclose(file);
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::MatrixXd all = Eigen::Map<Rows>(raw.data(), rows, columns + 1);
    const Eigen::MatrixXd a = all.leftCols(columns);
    const Eigen::VectorXd z = all.col(columns);
    const auto begun = std::chrono::steady_clock::now();
    double sum = 0;
    for (long gauge = 0; gauge < gauges; ++gauge) {
        const Eigen::VectorXd x = a.householderQr().solve(z);
        sum += x(columns - 1);
    }
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;
    std::printf("%.9g %.17g\n", took.count(), sum / gauges);
}
