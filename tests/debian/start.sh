#!/bin/sh
# In the machine: goes on with the script in the tests' directory on the host. The kernel's command line, which names the directory, has its
# variables handed to the first process.
mount -r -t hostfs -o / none /host
dir=$(tr '\0' '\n' < /proc/1/environ | sed -n 's/^WRENCHD_TEST_BOOT=//p')
exec sh "/host$dir/start"
