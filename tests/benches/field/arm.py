"""Reads a URDF for pinocchio.cpp, for Pinocchio's package brings its parser without headers. arm.py URDF TIP: the number of joints, then of each
its name, placement in the joint before (rotation by rows, translation) and body (mass, centre, inertia about it by rows), then the tip's placement."""

import sys

import pinocchio as pin

model = pin.buildModelFromUrdf(sys.argv[1])


def say(*parts):
    print(*(repr(float(number)) for part in parts for number in part.ravel()))


print(model.njoints - 1)
for joint in range(1, model.njoints):
    assert model.parents[joint] == joint - 1 and model.joints[joint].shortname() == "JointModelRZ"
    placed, body = model.jointPlacements[joint], model.inertias[joint]
    print(model.names[joint], float(body.mass))
    say(placed.rotation, placed.translation, body.lever, body.inertia)
tip = model.frames[model.getFrameId(sys.argv[2])]
assert tip.parentJoint == model.njoints - 1
say(tip.placement.rotation, tip.placement.translation)
