// The shortest loop: a Panda that holds the pose of its hand while a ball comes near.

#include <array>
#include <cstdio>
#include <vffnull.hpp>

int main() try {
    const auto robot = vff::Robot::named("panda");  // or vff::Robot::from_file("robot.toml")
    vff::Controller controller(robot, R"(
        task = "pose"
        stiffness = 900
        damping = 60
        null_damping = 12
        field = { kind = "bounded", gain = 80, influence = 0.25 }
    )");
    controller.check_period(0.001);
    const auto ball = controller.add_obstacle(R"(
        shape = { kind = "sphere", radius = 0.08 }
        position = [0, -1, 0.6]
    )");

    // Here stands the state that you measure, and here goes the torque that you command.
    const std::array<double, 7> q{0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785}, dq{};
    std::array<double, 7> tau{};
    vff::Status status = controller.set_reference(robot.pose(q));
    for (int k = 0; status && k < 1000; ++k) {
        const double t = 0.001 * k;
        const std::array<double, 3> position{-0.05, -0.4 + 0.2 * t, 0.62}, velocity{0.0, 0.2, 0.0};  // as a camera sees it
        status = controller.move_obstacle(ball, t, position, velocity);
        if (status) status = controller.observe(t, q, dq);
        if (status) status = controller.torque(tau);
    }

    vff::Terms terms;
    if (status) status = controller.terms(terms);
    if (!status) {
        std::fprintf(stderr, "%s: %s\n", status.name(), vff::message());
        return 1;
    }
    std::printf("torque of joint 2: %.3f N·m, clearance: %.4f m\n", tau[1], terms.least_clearance());
    return 0;
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
