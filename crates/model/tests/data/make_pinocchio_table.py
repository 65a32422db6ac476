#!/usr/bin/env python3
"""Writes pinocchio.json: loads, tip transport and motion of two arms, computed by Pinocchio.

    pip install pin
    python3 make_pinocchio_table.py

A fixed joint that is a section is made a revolute one that never turns, so that Pinocchio reports the force through it.
Loads are what the outboard side applies to the inboard side (Pinocchio's joint force, reversed), about the child link's
origin in the child link's axes, force first.
"""

import json
import os
import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin

HERE = os.path.dirname(os.path.abspath(__file__))
ARMS = [
    dict(
        urdf="arm_a.urdf", base="base_link", tip="tool0", locked=[],
        joints=["joint_1", "joint_2", "section_7", "joint_3", "section_8", "joint_4", "joint_5", "joint_6", "tool_mount"],
    ),
    dict(
        urdf="arm_b.urdf", base="pedestal", tip="point", locked=["lamp_hinge", "fan_hinge", "grip"],
        joints=["a1", "a2", "cut_1", "a3", "a4", "a5", "a6", "a7", "cut_2"],
    ),
]


def build(arm):
    tree = ElementTree.parse(os.path.join(HERE, arm["urdf"]))
    moving = []
    for joint in tree.getroot().findall("joint"):
        if joint.get("name") not in arm["joints"]:
            continue
        if joint.get("type") == "fixed":
            joint.set("type", "continuous")
            ElementTree.SubElement(joint, "axis", xyz="0 0 1")
        else:
            moving.append(joint.get("name"))
        joint.set("type", "revolute")
        if joint.find("limit") is None:
            ElementTree.SubElement(joint, "limit", lower="-9", upper="9", effort="1", velocity="1")
    model = pin.buildModelFromXML(ElementTree.tostring(tree.getroot(), encoding="unicode"))
    locked = [model.getJointId(name) for name in arm["locked"]]
    return pin.buildReducedModel(model, locked, pin.neutral(model)), moving


def rounded(values):
    return [float(f"{value:.12g}") for value in np.asarray(values).ravel()]


def instant(arm, model, moving, random, gravity, rates):
    data = model.createData()
    ids = [model.getJointId(name) for name in arm["joints"]]
    places = [model.joints[i].idx_v for i in ids]
    own = [model.joints[model.getJointId(name)].idx_v for name in moving]
    q, v, a = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
    q[own] = random.uniform(-2.5, 2.5, len(own))
    v[own] = rates * random.uniform(-2, 2, len(own))
    a[own] = rates * random.uniform(-8, 8, len(own))
    base, tip = model.getFrameId(arm["base"]), model.getFrameId(arm["tip"])
    pin.framesForwardKinematics(model, data, q)
    world_base = data.oMf[base].copy()
    model.gravity.linear = world_base.rotation @ np.array(gravity)
    torque = pin.rnea(model, data, q, v, a)
    row = dict(gravity_mps2=gravity, q=rounded(q[own]), qd=rounded(v[own]), qdd=rounded(a[own]))
    row["loads"] = [rounded(-data.f[i].vector) for i in ids]
    pin.forwardKinematics(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    wrench = random.uniform(-10, 10, 6)
    row["tip_wrench"] = rounded(wrench)
    row["tip_wrench_loads"] = [
        rounded((data.oMi[i].inverse() * data.oMf[tip]).act(pin.Force(wrench)).vector) for i in ids
    ]
    tip_in_base = world_base.inverse() * data.oMf[tip]
    row["tip_rotation"], row["tip_position"] = rounded(tip_in_base.rotation), rounded(tip_in_base.translation)
    twist = pin.getFrameVelocity(model, data, tip, pin.LOCAL)
    acceleration = pin.getFrameClassicalAcceleration(model, data, tip, pin.LOCAL)
    row["tip_velocity_rad_s"] = rounded(twist.angular)
    row["tip_acceleration_rad_s2"] = rounded(acceleration.angular)
    row["tip_acceleration_mps2"] = rounded(acceleration.linear)
    pin.computeRNEADerivatives(model, data, q, v, a)
    mass = data.M + np.triu(data.M, 1).T if np.allclose(np.tril(data.M, -1), 0) else data.M
    # Rows: sections in order; columns: coordinates.
    for name, matrix in [("torque_by_q", data.dtau_dq), ("torque_by_qd", data.dtau_dv), ("torque_by_qdd", mass)]:
        row[name] = [rounded(matrix[place, own]) for place in places]
    assert np.allclose(torque[own], [data.tau[i] for i in own])
    return row


def main():
    table = []
    for number, arm in enumerate(ARMS):
        model, moving = build(arm)
        random = np.random.default_rng(number)
        rows = []
        for index in range(8):
            gravity = [0.0, 0.0, -9.80665] if index % 2 == 0 else rounded(random.uniform(-6, 6, 3))
            rows.append(instant(arm, model, moving, random, gravity, 0.0 if index < 2 else 1.0))
        table.append(dict(urdf=arm["urdf"], base=arm["base"], tip=arm["tip"], sections=arm["joints"], moving=moving, rows=rows))
    with open(os.path.join(HERE, "pinocchio.json"), "w") as file:
        file.write("[\n" + ",\n".join(
            json.dumps({k: v for k, v in arm.items() if k != "rows"})[:-1]
            + ', "rows": [\n' + ",\n".join(json.dumps(row, separators=(",", ":")) for row in arm["rows"]) + "\n]}"
            for arm in table) + "\n]\n")


if __name__ == "__main__":
    main()
