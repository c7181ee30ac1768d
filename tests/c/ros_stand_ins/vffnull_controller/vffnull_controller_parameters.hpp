// A stand-in, see README.md: what generate_parameter_library makes of src/vffnull_controller_parameters.yaml.
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"

namespace vffnull_controller {

struct Params {
    std::vector<std::string> joints;
    std::string robot, settings, base_frame;
    std::vector<std::string> obstacles;
    std::string effort_when_deactivated = "zero";
    struct Obstacle {
        struct MapObstacles {
            std::string toml;
        };
        std::map<std::string, MapObstacles> obstacles_map;
    } obstacle;
    struct Points {
        std::int64_t most = 0;
        double radius = 0.02;
    } points;
};

class ParamListener {
public:
    explicit ParamListener(const std::shared_ptr<rclcpp_lifecycle::LifecycleNode>& node) : node_(node) { get_params(); }
    Params get_params() const {
        Params params;
        node_->read("joints", params.joints);
        node_->read("robot", params.robot);
        node_->read("settings", params.settings);
        node_->read("base_frame", params.base_frame);
        node_->read("obstacles", params.obstacles);
        node_->read("effort_when_deactivated", params.effort_when_deactivated);
        for (const auto& name : params.obstacles) {
            node_->read("obstacle." + name + ".toml", params.obstacle.obstacles_map[name].toml);
        }
        node_->read("points.most", params.points.most);
        node_->read("points.radius", params.points.radius);
        if (params.joints.empty()) throw std::runtime_error("joints: it is empty");
        return params;
    }

private:
    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_;
};

}  // namespace vffnull_controller
