// A ros2_control controller with the torque law of vffnull, as a beginning for yours. It claims the effort of each joint, and
// reads its position and velocity. Another controller can lead it by its reference interfaces; without one, topics do:
//
//     ~/target      geometry_msgs/PoseStamped   where the hand is to be
//     ~/obstacles   nav_msgs/Odometry           where the obstacle `child_frame_id` is, and how it moves
//     ~/points      sensor_msgs/PointCloud2     all that a camera sees; what was seen before is forgotten
//
// Not run on hardware, nor in ROS: compiled against vffnull.hpp and stand-ins of ROS's headers.

#ifndef VFFNULL_CONTROLLER__VFFNULL_CONTROLLER_HPP_
#define VFFNULL_CONTROLLER__VFFNULL_CONTROLLER_HPP_

#include <cstdint>
#include <deque>
#include <memory>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"
#include "geometry_msgs/msg/pose_stamped.hpp"
#include "nav_msgs/msg/odometry.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"
#include "realtime_tools/realtime_buffer.hpp"
#include "sensor_msgs/msg/point_cloud2.hpp"
#include "vffnull_controller/law.hpp"
#include "vffnull_controller/vffnull_controller_parameters.hpp"

namespace vffnull_controller {

class VffnullController : public controller_interface::ChainableControllerInterface {
public:
    controller_interface::InterfaceConfiguration command_interface_configuration() const override;
    controller_interface::InterfaceConfiguration state_interface_configuration() const override;

    controller_interface::CallbackReturn on_init() override;
    controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State& previous) override;
    controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State& previous) override;
    controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State& previous) override;
    controller_interface::CallbackReturn on_cleanup(const rclcpp_lifecycle::State& previous) override;

protected:
    std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override;
    bool on_set_chained_mode(bool chained_mode) override;
    controller_interface::return_type update_reference_from_subscribers(const rclcpp::Time& time,
                                                                        const rclcpp::Duration& period) override;
    controller_interface::return_type update_and_write_commands(const rclcpp::Time& time, const rclcpp::Duration& period) override;

private:
    /// A message as the loop takes it over: numbers in place, so that it frees nothing. The n-th one since the node began; 0 is none.
    template <class T>
    struct Numbered {
        T value{};
        std::int64_t stamp = 0;  // [ns], 0 if it is not known
        std::uint64_t number = 0;
    };
    template <class T>
    struct Topic {
        realtime_tools::RealtimeBuffer<Numbered<T>> buffer;  // from the threads of ROS to that of the loop, without waiting
        std::uint64_t sent = 0, taken = 0;

        void send(const T& value, std::int64_t stamp) { buffer.writeFromNonRT({value, stamp, ++sent}); }
        /// What has come since it was asked last, or nothing.
        const Numbered<T>* take() {
            const Numbered<T>* last = buffer.readFromRT();
            return last->number == taken ? nullptr : (taken = last->number, last);
        }
    };

    bool read();
    void write();

    std::shared_ptr<ParamListener> listener_;
    Params parameters_;
    std::shared_ptr<Law> law_;
    rclcpp::Subscription<geometry_msgs::msg::PoseStamped>::SharedPtr target_topic_;
    rclcpp::Subscription<nav_msgs::msg::Odometry>::SharedPtr obstacle_topic_;
    rclcpp::Subscription<sensor_msgs::msg::PointCloud2>::SharedPtr point_topic_;
    Topic<Reference> target_;
    std::deque<Topic<Motion>> obstacles_;
    Reference held_{};  // what is aimed at where nobody says anything else
    double t_ = 0.0;    // [s] of the loop, which does not jump with the clock
};

}  // namespace vffnull_controller

#endif  // VFFNULL_CONTROLLER__VFFNULL_CONTROLLER_HPP_
