// The torque of the first joint beside a box: as it is seen without a turn, turned, and without one again; then one that its table turns.

#include <cmath>
#include <cstdio>

#include "vffnull_controller/law.hpp"

using vffnull_controller::Law;
using vffnull_controller::Motion;

constexpr char SETTINGS[] = "task = 'position'\nfield = { kind = 'bounded', gain = 80.0, influence = 0.5 }\n";
const std::string BOX = "shape = { kind = 'box', size = [0.8, 0.1, 0.1] }\nposition = [0.3, 0.45, 0.55]\n";
constexpr double HALF = 0.7071067811865476;

Motion turned(double w, double z) {
    Motion motion;
    motion.position = {0.3, 0.45, 0.55};
    motion.orientation = {w, 0.0, 0.0, z};
    return motion;
}

Law begun(const std::string& obstacle) {
    Law law("panda", SETTINGS, {obstacle}, 0, 0.02);
    law.q = {0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785};
    law.begin(0.001);
    return law;
}

int main() {
    double t = 0.0;
    const auto seen = [&t](Law& law, const Motion& motion) {
        vff_phase phase{};
        static_cast<void>(law.see(0, t, motion));
        for (int k = 0; k < 1000; ++k) {
            static_cast<void>(law.cycle(t += 0.001, phase));
        }
        std::printf("%.17g\n", law.tau[0]);
    };
    Law plain = begun(BOX);
    seen(plain, turned(1.0, 0.0));
    seen(plain, turned(HALF, HALF));
    seen(plain, turned(1.0, 0.0));
    t = 0.0;
    Law lying = begun(BOX + "orientation = [0.7071067811865476, 0.0, 0.0, 0.7071067811865476]\n");
    seen(lying, turned(1.0, 0.0));
    return 0;
}
