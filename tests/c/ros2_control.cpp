// Runs the controller of examples/ros2_control as ROS would, by stand-ins of its headers: 600 cycles at a state that stays, with a
// target and an obstacle from "topics", then cycles without a state. Prints the torque of joint 2 after each part.

#include <array>
#include <cstdio>
#include <cstdlib>
#include <limits>

#include "vffnull_controller/vffnull_controller.hpp"

namespace {

void expect(bool holds, const char* what) {
    if (!holds) {
        std::fprintf(stderr, "%s\n", what);
        std::exit(1);
    }
}

}  // namespace

int main() {
    using controller_interface::CallbackReturn;
    using controller_interface::return_type;
    using Numbers = std_msgs::msg::Float64MultiArray;

    vffnull_controller::VffnullController controller;
    const auto node = controller.get_node();
    const rclcpp_lifecycle::State before;
    expect(controller.on_init() == CallbackReturn::SUCCESS, "on_init");
    expect(controller.on_configure(before) == CallbackReturn::ERROR, "on_configure without a robot");
    std::vector<std::string> joints;
    for (int i = 1; i <= 7; ++i) joints.push_back("panda_joint" + std::to_string(i));
    node->parameters["joints"] = {joints};
    node->parameters["robot"] = {std::string("panda")};
    node->parameters["settings"] = {std::string(SETTINGS)};
    node->parameters["obstacles"] = {std::vector<std::string>{OBSTACLE}};
    expect(controller.on_configure(before) == CallbackReturn::SUCCESS, "on_configure");
    expect(controller.command_interface_configuration().names.at(1) == "panda_joint2/effort", "commands");
    expect(controller.state_interface_configuration().names.at(3) == "panda_joint2/velocity", "states");

    std::array<double, 7> q{0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785}, dq{}, tau{};
    std::vector<hardware_interface::LoanedCommandInterface> commands;
    std::vector<hardware_interface::LoanedStateInterface> states;
    for (std::size_t i = 0; i < 7; ++i) {
        commands.emplace_back(&tau[i]);
        states.emplace_back(&q[i]);
        states.emplace_back(&dq[i]);
    }
    controller.assign_interfaces(std::move(commands), std::move(states));
    expect(controller.on_activate(before) == CallbackReturn::SUCCESS, "on_activate");

    std::int64_t k = 0;
    const auto cycles = [&](int count) {
        auto last = return_type::OK;
        for (int i = 0; i < count; ++i, ++k) {
            last = controller.update(rclcpp::Time(1'000'000 * k), rclcpp::Duration(1'000'000));
        }
        std::printf("%.9f\n", tau[1]);
        return last;
    };
    expect(cycles(600) == return_type::OK, "it holds");
    node->publish("~/target", Numbers{{1.0, 2.0}});  // too short: told, and left alone
    node->publish("~/target", Numbers{{0.3, 0.05, 0.55, 0.0, 1.0, 0.0, 0.0}});
    node->publish("~/obstacles", Numbers{{-0.05, -0.15, 0.62, 0.0, 0.2, 0.0}});
    expect(cycles(1) == return_type::OK, "it aims");
    q[3] = std::numeric_limits<double>::quiet_NaN();
    expect(cycles(100) == return_type::OK, "it damps");
    expect(cycles(3000) == return_type::ERROR, "it is lost");
    expect(controller.on_deactivate(before) == CallbackReturn::SUCCESS, "on_deactivate");
    return 0;
}
