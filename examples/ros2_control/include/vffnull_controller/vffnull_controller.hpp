// A ros2_control controller with the torque law of vffnull, as a beginning for yours. It claims the effort of each joint, and
// reads its position and velocity. Topics:
//
//     ~/target      std_msgs/Float64MultiArray   pose, and if you like velocity and acceleration, one after the other
//     ~/obstacles   std_msgs/Float64MultiArray   of each obstacle position and velocity
//
// Not run on hardware, nor in ROS: compiled against vffnull.hpp and stand-ins of ROS's headers.

#ifndef VFFNULL_CONTROLLER__VFFNULL_CONTROLLER_HPP_
#define VFFNULL_CONTROLLER__VFFNULL_CONTROLLER_HPP_

#include <memory>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"
#include "realtime_tools/realtime_buffer.hpp"
#include "std_msgs/msg/float64_multi_array.hpp"
#include "vffnull_controller/law.hpp"

namespace vffnull_controller {

class VffnullController : public controller_interface::ControllerInterface {
public:
    controller_interface::InterfaceConfiguration command_interface_configuration() const override;
    controller_interface::InterfaceConfiguration state_interface_configuration() const override;

    controller_interface::CallbackReturn on_init() override;
    controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State& previous) override;
    controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State& previous) override;
    controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State& previous) override;

    controller_interface::return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) override;

private:
    using Numbers = std_msgs::msg::Float64MultiArray;

    bool read();

    std::vector<std::string> joints_;
    std::unique_ptr<Law> law_;
    rclcpp::Subscription<Numbers>::SharedPtr target_topic_, obstacle_topic_;
    // From the threads of ROS to that of the loop, without waiting.
    realtime_tools::RealtimeBuffer<std::shared_ptr<Target>> target_;
    realtime_tools::RealtimeBuffer<std::shared_ptr<std::vector<double>>> obstacles_;
    std::shared_ptr<Target> aimed_;
    std::shared_ptr<std::vector<double>> seen_;
    double start_ = 0.0;
};

}  // namespace vffnull_controller

#endif  // VFFNULL_CONTROLLER__VFFNULL_CONTROLLER_HPP_
