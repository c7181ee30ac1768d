/* A loop that may make no system call: once it has begun, the kernel kills the process for any but write and exit.
 *
 * With an argument it adds an obstacle in between, a large cloud, whose memory the system must give: the test can fail. */

#define _GNU_SOURCE
#include <linux/seccomp.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <vffnull.h>

static const char *const SETTINGS = "task = 'pose'\navoidance = 'cbf'\nyielding = { preview = { trigger = 1.2 } }\n"
                                    "field = { kind = 'bounded', gain = 80, influence = 0.25 }";
static const char *const BALL = "shape = { kind = 'sphere', radius = 0.08 }\nposition = [-0.05, -0.3, 0.62]";
static const char *const CLOUD = "shape = { kind = 'points', points = [], radius = 0.01 }\nposition = [0.5, 0.3, 0.6]";
static double points[3 * 100];

int main(int count, char **arguments) {
    (void)arguments;
    vff_robot *robot = NULL;
    vff_controller *controller = NULL;
    vff_cloud *cloud = NULL;
    uint32_t ball = 0, id = 0;
    double q[7] = {0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785}, dq[7] = {0.0}, tau[7], pose[7];
    for (int i = 0; i < 300; i++) {
        points[i] = 0.002 * i - 0.3;
    }
    int failed = vff_robot_named("panda", &robot) || vff_controller_new(robot, SETTINGS, &controller) ||
                 vff_controller_add_obstacle(controller, BALL, &ball) || vff_controller_add_obstacle(controller, CLOUD, &id) ||
                 vff_controller_cloud(controller, id, 100, &cloud) || vff_robot_pose(robot, q, 7, pose, 7) ||
                 vff_controller_set_reference(controller, pose, 7, NULL, 0, NULL, 0) || vff_cloud_update(cloud, points, 100);
    if (failed) {
        fprintf(stderr, "%s\n", vff_last_message());
        return 1;
    }
    if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_STRICT) != 0) {
        return 77; /* the kernel does not offer it */
    }
    for (int k = 0; k < 200 && !failed; k++) {
        const double t = 0.001 * k, position[3] = {-0.05, -0.3 + 0.3 * t, 0.62}, velocity[3] = {0.0, 0.3, 0.0};
        q[0] = 0.1 * sin(t);
        dq[0] = 0.1 * cos(t);
        vff_terms terms;
        failed = vff_controller_move_obstacle(controller, ball, t, position, velocity, 3) ||
                 vff_controller_observe(controller, t, q, dq, 7) || vff_controller_torque(controller, tau, 7) ||
                 vff_controller_terms(controller, &terms) ||
                 vff_controller_observe(controller, t, NULL, dq, 7) != VFF_STATUS_NULL;
        if (count > 1) {
            failed = failed || vff_controller_cloud(controller, id, 50000, &cloud);
        }
    }
    syscall(SYS_exit, failed);
}
