/* What a cycle costs in C: move the ball, observe the state, compute the torque. `cost 1000000` */

#define _POSIX_C_SOURCE 199309L
#include "cost.h"
#include <vffnull.h>

int main(int count, char **arguments) {
    const long cycles = cost_cycles(count, arguments);
    long *times = malloc((size_t)cycles * sizeof *times);
    vff_robot *robot = NULL;
    vff_controller *controller = NULL;
    uint32_t ball = 0;
    double q[COST_JOINTS], dq[COST_JOINTS], tau[COST_JOINTS], pose[7];
    cost_state(0, q, dq);
    int failed = times == NULL;
    failed = failed || vff_robot_named("panda", &robot) || vff_controller_new(robot, COST_SETTINGS, &controller) ||
             vff_controller_add_obstacle(controller, COST_BALL, &ball) || vff_robot_pose(robot, q, COST_JOINTS, pose, 7) ||
             vff_controller_set_reference(controller, pose, 7, NULL, 0, NULL, 0);
    for (long k = 0; !failed && k < cycles; k++) {
        const double t = 0.001 * (double)k;
        const double position[3] = {-0.05, 0.3 * sin(t), 0.62}, velocity[3] = {0.0, 0.3 * cos(t), 0.0};
        cost_state(k, q, dq);
        const long begun = cost_now();
        failed = vff_controller_move_obstacle(controller, ball, t, position, velocity, 3) ||
                 vff_controller_observe(controller, t, q, dq, COST_JOINTS) ||
                 vff_controller_torque(controller, tau, COST_JOINTS);
        times[k] = cost_now() - begun;
    }
    if (failed) {
        fprintf(stderr, "%s\n", vff_last_message());
    } else {
        cost_report("C", times, cycles);
    }
    vff_controller_free(controller);
    vff_robot_free(robot);
    free(times);
    return failed;
}
