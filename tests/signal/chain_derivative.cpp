// The derivatives of all joints at once are those of each by itself.
#include "bumpstop/signal/chain_derivative.hpp"

#include <vector>

#include "bumpstop/model/chain.hpp"
#include "bumpstop/signal/causal_derivative.hpp"
#include "math/check.hpp"

using namespace bumpstop;

static void chain_derivative_is_the_causal_one() {
    for (int columns : {1, 7, 16}) {
        ChainDerivative<max_joints> together(8, 2, columns);
        std::vector<CausalDerivative<double>> single(std::size_t(columns), CausalDerivative<double>(8, 2));
        double t = 0;
        for (int i = 0; i < 40; ++i) {
            double q[max_joints] = {};
            t += checks::uniform(0.001, 0.003);
            for (int j = 0; j < columns; ++j) q[j] = checks::normal();
            const bool full = together.update(t, q);
            CHECK(full == (i >= 7));
            for (int j = 0; j < columns; ++j) {
                const CausalEstimate<double> e = single[std::size_t(j)].update(t, q[j]);
                if (!full) continue;
                CHECK_NEAR(together.rate()[j], e.rate, 1e-10 * (1 + std::fabs(e.rate)));
                CHECK_NEAR(together.acceleration()[j], e.acceleration, 1e-10 * (1 + std::fabs(e.acceleration)) * 1e3);
            }
        }
    }
}

int main() {
    chain_derivative_is_the_causal_one();
    return checks::result();
}
