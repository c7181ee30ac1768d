// The loops of docs/c.md, compiled against stand-ins of what it takes from libfranka (franka/robot.h, control_types.h, duration.h).
// The test writes the page's program to page.inc, and what a loop does that feels contacts to touch.inc.

#include <array>
#include <functional>
#include <vffnull.hpp>

namespace franka {
struct RobotState {
    std::array<double, 7> q{}, dq{}, tau_ext_hat_filtered{};
};
struct Duration {
    double toSec() const noexcept { return 0.001; }
};
struct Torques {
    explicit Torques(const std::array<double, 7>& torques) noexcept : tau_J(torques) {}
    std::array<double, 7> tau_J;
    bool motion_finished = false;
};
inline Torques MotionFinished(Torques command) noexcept {
    command.motion_finished = true;
    return command;
}
struct Robot {
    std::array<double, 7> q{};
    std::function<void(int)> during;
    int cycles = 0;
    void control(const std::function<Torques(const RobotState&, Duration)>& callback) {
        for (bool finished = false; !finished; ++cycles) {
            during(cycles);
            const Torques command = callback(RobotState{q, {}, {}}, Duration{});
            finished = command.motion_finished || cycles == 10000;
        }
    }
};
}  // namespace franka

int main() {
    const auto panda = vff::Robot::named("panda");
    vff::Controller controller(panda, R"(
        task = "pose"
        stiffness = 900
        damping = 60
        command = { gravity = "robot", torque_rate = 1000 }
    )");
    const auto feels = [&controller](const franka::RobotState& state, franka::Duration since) -> franka::Torques {
        double t = 0.0;
        vff_phase phase{};
        std::array<double, 7> tau{}, tau_ext{};
#include "touch.inc"
        return franka::Torques(tau);
    };
    static_cast<void>(feels);
    franka::Robot robot;
    robot.q = {0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785};
    bool well = static_cast<bool>(controller.set_reference(panda.pose(robot.q)));
    robot.during = [&](int cycle) { well = well && (cycle != 100 || controller.stop()); };
#include "page.inc"
    return well && robot.cycles > 100 && robot.cycles < 10000 ? 0 : 1;
}
