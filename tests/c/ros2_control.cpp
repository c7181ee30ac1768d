// Runs the controller of examples/ros2_control as ROS would, by stand-ins of its headers: cycles at a state that stays, led by "topics", by
// another controller, and by nobody, then without a state. Prints the torque of joint 2 after each part. No cycle may allocate or free.

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>

#include "vffnull_controller/vffnull_controller.hpp"

namespace {

long allocations = 0;

void expect(bool holds, const char* what) {
    if (!holds) {
        std::fprintf(stderr, "%s\n", what);
        std::exit(1);
    }
}

geometry_msgs::msg::PoseStamped pose(const char* frame, double x, double y, double z) {
    geometry_msgs::msg::PoseStamped message;
    message.header.frame_id = frame;
    message.pose.position = {x, y, z};
    message.pose.orientation = {1.0, 0.0, 0.0, 0.0};
    return message;
}

sensor_msgs::msg::PointCloud2 cloud(const char* frame, const std::vector<float>& xyz) {
    sensor_msgs::msg::PointCloud2 message;
    message.header.frame_id = frame;
    message.height = 1;
    message.width = static_cast<std::uint32_t>(xyz.size() / 3);
    message.point_step = 12;
    for (const char* axis : {"x", "y", "z"}) {
        message.fields.push_back({axis, static_cast<std::uint32_t>(4 * message.fields.size()), sensor_msgs::msg::PointField::FLOAT32, 1});
    }
    message.data.resize(4 * xyz.size());
    std::memcpy(message.data.data(), xyz.data(), message.data.size());
    return message;
}

}  // namespace

void* operator new(std::size_t size) {
    ++allocations;
    if (void* made = std::malloc(size)) return made;
    throw std::bad_alloc();
}
void operator delete(void* at) noexcept {
    ++allocations;
    std::free(at);
}
void operator delete(void* at, std::size_t) noexcept { operator delete(at); }

int main() {
    using controller_interface::CallbackReturn;
    using controller_interface::return_type;

    vffnull_controller::VffnullController controller;
    const auto node = controller.get_node();
    const rclcpp_lifecycle::State before;
    expect(controller.on_init() == CallbackReturn::ERROR, "on_init without joints");
    std::vector<std::string> joints;
    for (int i = 1; i <= 7; ++i) joints.push_back("panda_joint" + std::to_string(i));
    auto& parameters = node->parameters;
    parameters["joints"] = joints;
    expect(controller.on_init() == CallbackReturn::SUCCESS, "on_init");
    expect(controller.on_configure(before) == CallbackReturn::ERROR, "on_configure without a robot");
    parameters["robot"] = std::string("panda");
    parameters["settings"] = std::string(SETTINGS);
    parameters["base_frame"] = std::string("panda_link0");
    parameters["obstacles"] = std::vector<std::string>{"ball"};
    parameters["obstacle.ball.toml"] = std::string(OBSTACLE);
    parameters["points.most"] = std::int64_t{3};
    expect(controller.on_configure(before) == CallbackReturn::SUCCESS, "on_configure");
    expect(controller.command_interface_configuration().names.at(1) == "panda_joint2/effort", "commands");
    expect(controller.state_interface_configuration().names.at(3) == "panda_joint2/velocity", "states");
    auto references = controller.export_reference_interfaces();
    expect(references.size() == 19 && references[3].get_name() == "vffnull_controller/orientation.w" &&
               references[18].get_name() == "vffnull_controller/acceleration.angular.z",
           "references");

    std::array<double, 7> q{0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785}, dq{}, tau{};
    std::vector<hardware_interface::LoanedCommandInterface> commands;
    std::vector<hardware_interface::LoanedStateInterface> states;
    for (std::size_t i = 0; i < 7; ++i) {
        commands.emplace_back(&tau[i]);
        states.emplace_back(&q[i]);
        states.emplace_back(&dq[i]);
    }
    controller.assign_interfaces(std::move(commands), std::move(states));
    node->publish("~/target", pose("panda_link0", 0.9, 0.9, 0.9));  // of before: it is not gone to
    expect(controller.on_activate(before) == CallbackReturn::SUCCESS, "on_activate");

    std::int64_t k = 0;
    const std::int64_t clock = 1'700'000'000'000'000'000;  // which jumps: the loop has its own time
    const auto cycles = [&](int count) {
        auto last = return_type::OK;
        const long began = allocations;
        for (int i = 0; i < count; ++i, ++k) {
            last = controller.update(rclcpp::Time(clock + (k % 2) * 5'000'000'000), rclcpp::Duration(1'000'000));
        }
        expect(allocations == began, "a cycle allocates");
        std::printf("%.9f\n", tau[1]);
        return last;
    };
    expect(cycles(600) == return_type::OK, "it holds");

    // Each of these is told, and left alone.
    node->publish("~/target", pose("world", 0.3, 0.05, 0.55));
    node->publish("~/target", pose("panda_link0", std::nan(""), 0.05, 0.55));
    auto unturned = pose("panda_link0", 0.3, 0.05, 0.55);
    unturned.pose.orientation = {0.0, 0.0, 0.0, 0.0};
    node->publish("~/target", unturned);
    nav_msgs::msg::Odometry ball;
    ball.header.frame_id = "panda_link0";
    ball.child_frame_id = "bell";
    node->publish("~/obstacles", ball);
    auto wide = cloud("panda_link0", {0.0F, 0.0F, 0.0F});
    wide.fields[0].datatype = sensor_msgs::msg::PointField::FLOAT64;
    node->publish("~/points", wide);
    auto cut = cloud("panda_link0", {0.0F, 0.0F, 0.0F});
    cut.width = 2;
    node->publish("~/points", cut);
    expect(cycles(1) == return_type::OK, "nothing has changed");

    node->publish("~/target", pose("panda_link0", 0.3, 0.05, 0.55));
    // Turned a quarter about z, it goes along its own x: the world's y. It was seen 20 ms ago.
    ball.child_frame_id = "ball";
    ball.pose.pose = {{-0.05, -0.154, 0.62}, {0.0, 0.0, std::sqrt(0.5), std::sqrt(0.5)}};
    ball.twist.twist.linear = {0.2, 0.0, 0.0};
    const std::int64_t seen = clock + (k % 2) * 5'000'000'000 - 20'000'000;
    ball.header.stamp = {static_cast<std::int32_t>(seen / 1'000'000'000), static_cast<std::uint32_t>(seen % 1'000'000'000)};
    node->publish("~/obstacles", ball);
    // One point is none, and one of the others is one too many.
    const float none = std::numeric_limits<float>::quiet_NaN();
    node->publish("~/points", cloud("panda_link0", {0.25F, -0.25F, 0.6F, 9.0F, 9.0F, 9.0F, none, 0.0F, 0.0F, 9.0F, 9.0F, 9.0F}));
    {
        // Of obstacles that turn, the first time allocates, so that this cycle is not counted.
        controller.update(rclcpp::Time(clock + (k % 2) * 5'000'000'000), rclcpp::Duration(1'000'000));
        ++k;
        std::printf("%.9f\n", tau[1]);
    }
    expect(cycles(1) == return_type::OK, "it aims");

    expect(controller.set_chained_mode(true), "it can be led");
    node->publish("~/target", pose("panda_link0", 0.9, 0.9, 0.9));  // nobody listens
    expect(cycles(1) == return_type::OK, "it stays where it was to be");
    const std::array<double, 10> led{0.31, 0.05, 0.55, 0.0, 1.0, 0.0, 0.0, 0.1, 0.0, 0.0};
    for (std::size_t i = 0; i < led.size(); ++i) expect(references[i].set_value(led[i]), "a reference");
    expect(cycles(1) == return_type::OK, "it is led");

    q[3] = std::numeric_limits<double>::quiet_NaN();
    expect(cycles(100) == return_type::OK, "it damps");
    expect(cycles(3000) == return_type::ERROR, "it is lost");
    tau.fill(1.0);
    expect(controller.on_deactivate(before) == CallbackReturn::SUCCESS && tau == std::array<double, 7>{}, "nothing is left");
    expect(controller.on_cleanup(before) == CallbackReturn::SUCCESS, "on_cleanup");

    parameters["effort_when_deactivated"] = std::string("gravity");
    q[3] = -2.356;
    expect(controller.on_configure(before) == CallbackReturn::SUCCESS, "on_configure once more");
    expect(controller.on_activate(before) == CallbackReturn::SUCCESS, "on_activate once more");
    expect(controller.on_deactivate(before) == CallbackReturn::SUCCESS, "on_deactivate");
    std::printf("%.9f\n", tau[1]);
    return 0;
}
