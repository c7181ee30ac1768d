/* A depth camera above a Panda: what it sees, without the arm, goes to the controller. Here the pictures are made up: a ball that
 * comes from the side, above a table. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <vffnull.h>

enum { ROWS = 60, COLUMNS = 80, MOST = 5000 };

static void check(vff_status status) {
    if (status != VFF_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", vff_status_name(status), vff_last_message());
        exit(1);
    }
}

static void take(uint16_t depth[ROWS][COLUMNS], int step) {
    for (int row = 0; row < ROWS; ++row) {
        for (int column = 0; column < COLUMNS; ++column) {
            const int x = column - 15 - step, y = row - 30;
            depth[row][column] = x * x + y * y < 30 ? 900 : 1500;
        }
    }
}

int main(void) {
    const char *cameras = "[[cameras]]\n"
                          "columns = 80\nrows = 60\nfocal = [75.0, 75.0]\ncentre = [39.5, 29.5]\n"
                          "position = [0.6, 0.0, 1.5]\norientation = [0.0, 1.0, 0.0, 0.0]\n" /* straight down */
                          "[settings]\nstride = 1\n"
                          "[[known]]\nshape = { kind = 'half_space', normal = [0.0, 0.0, 1.0] }\n"; /* the table */
    const char *cloud_of = "shape = { kind = 'points', points = [], radius = 0.018 }";
    const double ready[7] = {0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785}, rest[7] = {0.0};
    const double place[3] = {0.3, 0.0, 0.6};

    vff_robot *robot = NULL;
    vff_perceiver *perceiver = NULL;
    vff_controller *controller = NULL;
    vff_cloud *cloud = NULL;
    uint32_t id = 0;
    check(vff_robot_named("panda", &robot));
    check(vff_perceiver_new(robot, cameras, &perceiver));
    check(vff_controller_new(robot, "field = { kind = 'bounded', gain = 40.0, influence = 0.4 }", &controller));
    check(vff_controller_add_obstacle(controller, cloud_of, &id));
    check(vff_controller_cloud(controller, id, MOST, &cloud));

    static uint16_t depth[ROWS][COLUMNS];
    double t = 0.0;
    for (int step = 0; step < 8; ++step) { /* the thread of the pictures */
        t = step / 30.0;
        take(depth, step);
        vff_picture_counts counts;
        check(vff_perceiver_observe(perceiver, t, ready, rest, 7));
        check(vff_perceiver_see_millimetres(perceiver, 0, t, &depth[0][0], ROWS, COLUMNS, sizeof depth[0], &counts));
        check(vff_perceiver_send(perceiver, cloud));
        if (counts.left_out != 0) {
            fprintf(stderr, "no room for %zu pixels\n", counts.left_out);
        }
    }
    size_t count = 0;
    check(vff_perceiver_size(perceiver, &count, &t, NULL));
    double points[3 * MOST], velocities[3 * MOST];
    check(vff_perceiver_points(perceiver, points, velocities, count));

    double tau[7]; /* the loop */
    check(vff_controller_set_reference(controller, place, 3, NULL, 0, NULL, 0));
    check(vff_controller_observe(controller, t, ready, rest, 7));
    check(vff_controller_torque(controller, tau, 7));
    vff_terms terms;
    check(vff_controller_terms(controller, &terms));
    double nearest = terms.clearance[0];
    for (size_t link = 1; link < terms.joints; ++link) {
        nearest = terms.clearance[link] < nearest ? terms.clearance[link] : nearest;
    }
    double fastest = 0.0;
    for (size_t k = 0; k < count; ++k) {
        fastest = velocities[3 * k] > fastest ? velocities[3 * k] : fastest;
    }
    printf("%zu points, up to %.2f m/s, %.3f m from the arm\n", count, fastest, nearest);

    vff_cloud_free(cloud);
    vff_controller_free(controller);
    vff_perceiver_free(perceiver);
    vff_robot_free(robot);
    return 0;
}
