// Peer of event mode: the least that could answer. echo IN OUT ID: after each frame with this identifier two frames on OUT, at once.
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

static int bound(const char* name) {
    const int fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    struct ifreq request = {0};
    strncpy(request.ifr_name, name, IFNAMSIZ - 1);
    if (fd < 0 || ioctl(fd, SIOCGIFINDEX, &request) < 0) exit(1);
    struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = request.ifr_ifindex};
    if (bind(fd, (struct sockaddr*)&address, sizeof address) < 0) exit(1);
    return fd;
}

int main(int argc, char** argv) {
    if (argc != 4) return 2;
    const int in = bound(argv[1]), out = bound(argv[2]);
    const unsigned last = strtoul(argv[3], NULL, 16);
    setsockopt(out, SOL_CAN_RAW, CAN_RAW_FILTER, NULL, 0);
    const struct sched_param real_time = {.sched_priority = 50};
    sched_setscheduler(0, SCHED_FIFO, &real_time);
    mlockall(MCL_CURRENT | MCL_FUTURE);
    struct can_frame frame;
    while (read(in, &frame, sizeof frame) == sizeof frame) {
        if (frame.can_id != last) continue;
        for (frame.can_id = 0x400; frame.can_id < 0x402; ++frame.can_id)
            if (write(out, &frame, sizeof frame) < 0) return 1;
    }
}
