/* The robot's camera in C: 30 images a second, each drawn in place in shared memory.
 *
 * A driver of a real camera would let V4L2 write the pixels. Here they show a ball that rolls from side to side. The
 * camera turns with the robot, as the controller commands.
 */
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <time.h>

#include "geometry_msgs/msg/Twist.h"
#include "sensor_msgs/msg/Image.h"

enum { WIDTH = 640, HEIGHT = 480, STEP = 3 * WIDTH, RADIUS = 40 };
#define SECOND_NS 1000000000LL
#define PERIOD_NS (SECOND_NS / 30)
#define FOCAL_PX 554.0

static volatile sig_atomic_t has_ended;
static double yaw_rate; /* of the robot, rad/s */

static void end(int number)
{
    (void)number;
    has_ended = 1;
}

static long long clock_ns(clockid_t id)
{
    struct timespec now;
    clock_gettime(id, &now);
    return now.tv_sec * SECOND_NS + now.tv_nsec;
}

static void obey(void *user, const busd_message *taken)
{
    geometry_msgs__msg__Twist command;
    (void)user;
    if (geometry_msgs__msg__Twist__decode(taken, &command, NULL) == 0 && isfinite(command.angular.z))
        yaw_rate = command.angular.z;
}

/* Draws a dark pattern with an orange ball in this direction, in radians to the left. */
static void draw(unsigned char *pixels, double bearing)
{
    const double column = WIDTH / 2 - FOCAL_PX * tan(bearing);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const double dx = x - column, dy = y - HEIGHT / 2;
            const int is_ball = fabs(bearing) < 1 && dx * dx + dy * dy < RADIUS * RADIUS;
            unsigned char *pixel = pixels + y * STEP + 3 * x;
            pixel[0] = is_ball ? 255 : (unsigned char)(x / 16);
            pixel[1] = is_ball ? 128 : (unsigned char)(y / 16);
            pixel[2] = is_ball ? 16 : 32;
        }
}

static int publish(busd_publisher *publisher, double bearing)
{
    void *place;
    const long long stamp_ns = clock_ns(CLOCK_REALTIME);
    sensor_msgs__msg__Image image = {.height = HEIGHT, .width = WIDTH, .step = STEP};
    image.header.stamp.sec = (int32_t)(stamp_ns / SECOND_NS);
    image.header.stamp.nanosec = (uint32_t)(stamp_ns % SECOND_NS);
    image.header.frame_id = busd_text_of("camera");
    image.encoding = busd_text_of("rgb8");
    const size_t room = sensor_msgs__msg__Image__size(&image) + 8 + STEP * HEIGHT;
    const int status = busd_loan(publisher, room, &place);
    if (status < 0)
        return status;
    busd_out out = {.bytes = place, .room = room, .is_fixed = true};
    sensor_msgs__msg__Image__put(&out, &image);
    out.size -= 2; /* the empty data, which is the last field */
    busd_put_length(&out, STEP * HEIGHT, 0xc4, 0xc5);
    draw(busd_put_room(&out, STEP * HEIGHT), bearing);
    return busd_publish_loan(publisher, out.size);
}

/* Publishes until a signal. 0, or a negative errno. */
static int run(busd_bus *bus, busd_publisher *publisher)
{
    double heading = 0;
    const long long begin_ns = clock_ns(CLOCK_MONOTONIC);
    for (long long due_ns = begin_ns; !has_ended;) {
        const long long left_ns = due_ns - clock_ns(CLOCK_MONOTONIC);
        int status = busd_wait(bus, left_ns > 0 ? (int)(left_ns / 1000000) + 1 : 0); /* callbacks are called meanwhile */
        if (status >= 0 && clock_ns(CLOCK_MONOTONIC) >= due_ns) {
            const double seconds = (double)(due_ns - begin_ns) / SECOND_NS;
            heading += yaw_rate * PERIOD_NS / SECOND_NS;
            status = publish(publisher, sin(0.5 * seconds) - heading);
            due_ns += PERIOD_NS;
        }
        if (status < 0)
            return status;
    }
    return 0;
}

int main(void)
{
    busd_bus *bus;
    busd_node *node;
    busd_publisher *publisher;
    busd_subscription *subscription;
    busd_stats stats;
    const busd_qos sensor = BUSD_QOS_SENSOR, newest = {.depth = 1};

    signal(SIGINT, end);
    signal(SIGTERM, end);
    if (busd_connect(&bus, NULL, "camera") < 0 || busd_node_create(bus, "camera", NULL, &node) < 0
        || busd_publisher_create(node, "/camera/image_raw", &sensor_msgs__msg__Image__type, &sensor, &publisher) < 0
        || busd_subscription_create(node, "/cmd_vel", &geometry_msgs__msg__Twist__type, &newest, obey, NULL, &subscription) < 0
        || run(bus, publisher) < 0) {
        fprintf(stderr, "camera: %s\n", busd_error(bus));
        busd_close(bus);
        return 1;
    }
    busd_publisher_stats(publisher, &stats);
    printf("camera (C): %llu images published\n", (unsigned long long)stats.samples);
    busd_close(bus);
    return 0;
}
