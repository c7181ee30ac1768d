// What a cycle costs in C++: move the ball, observe the state, compute the torque. `cost_cpp 1000000`

#include "cost.h"

#include <array>
#include <cmath>
#include <vector>
#include <vffnull.hpp>

int main(int count, char** arguments) try {
    std::vector<long> times(static_cast<std::size_t>(cost_cycles(count, arguments)));
    const auto robot = vff::Robot::named("panda");
    vff::Controller controller(robot, COST_SETTINGS);
    const auto ball = controller.add_obstacle(COST_BALL);
    std::array<double, COST_JOINTS> q, dq, tau;
    cost_state(0, q.data(), dq.data());
    vff::Status status = controller.set_reference(robot.pose(q));
    long k = 0;
    for (long& time : times) {
        const double t = 0.001 * static_cast<double>(k);
        const std::array<double, 3> position{-0.05, 0.3 * std::sin(t), 0.62}, velocity{0.0, 0.3 * std::cos(t), 0.0};
        cost_state(k++, q.data(), dq.data());
        const long begun = cost_now();
        if (status) status = controller.move_obstacle(ball, t, position, velocity);
        if (status) status = controller.observe(t, q, dq);
        if (status) status = controller.torque(tau);
        time = cost_now() - begun;
    }
    if (!status) {
        std::fprintf(stderr, "%s: %s\n", status.name(), vff::message());
        return 1;
    }
    cost_report("C++", times.data(), static_cast<long>(times.size()));
    return 0;
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
