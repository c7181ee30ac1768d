/* The shortest loop: a Panda that holds the pose of its hand while a ball comes near. */

#include <stdio.h>
#include <stdlib.h>
#include <vffnull.h>

enum { JOINTS = 7 };

static void check(vff_status status) {
    if (status != VFF_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", vff_status_name(status), vff_last_message());
        exit(EXIT_FAILURE);
    }
}

int main(void) {
    if (vff_abi_version() != VFF_ABI_VERSION) {
        fprintf(stderr, "libvffnull %s is not that of the header\n", vff_version());
        return EXIT_FAILURE;
    }
    vff_robot *robot = NULL; /* or vff_robot_from_file("robot.toml", &robot) */
    vff_controller *controller = NULL;
    uint32_t ball = 0;
    check(vff_robot_named("panda", &robot));
    check(vff_controller_new(robot,
                             "task = 'pose'\nstiffness = 900\ndamping = 60\nnull_damping = 12\n"
                             "field = { kind = 'bounded', gain = 80, influence = 0.25 }",
                             &controller));
    check(vff_controller_check_period(controller, 0.001));
    check(vff_controller_add_obstacle(controller, "shape = { kind = 'sphere', radius = 0.08 }\nposition = [0, -1, 0.6]",
                                      &ball));

    /* Here stands the state that you measure, and here goes the torque that you command. */
    double q[JOINTS] = {0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785}, dq[JOINTS] = {0.0}, tau[JOINTS];
    double pose[7]; /* position and quaternion */
    check(vff_robot_pose(robot, q, JOINTS, pose, 7));
    check(vff_controller_set_reference(controller, pose, 7, NULL, 0, NULL, 0));
    for (int k = 0; k < 1000; k++) {
        const double t = 0.001 * k;
        const double position[3] = {-0.05, -0.4 + 0.2 * t, 0.62}, velocity[3] = {0.0, 0.2, 0.0}; /* as a camera sees it */
        check(vff_controller_move_obstacle(controller, ball, t, position, velocity, 3));
        check(vff_controller_observe(controller, t, q, dq, JOINTS));
        check(vff_controller_torque(controller, tau, JOINTS));
    }

    vff_terms terms;
    check(vff_controller_terms(controller, &terms));
    double clearance = terms.clearance[0];
    for (size_t i = 1; i < terms.joints; i++) {
        clearance = terms.clearance[i] < clearance ? terms.clearance[i] : clearance;
    }
    printf("torque of joint 2: %.3f N·m, clearance: %.4f m\n", tau[1], clearance);
    vff_controller_free(controller);
    vff_robot_free(robot);
    return EXIT_SUCCESS;
}
