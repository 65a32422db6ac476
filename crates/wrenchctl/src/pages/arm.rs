//! The arm with each gauge's nominal and actual sensing axis.

use model::sensing::{ActualFrame, Compliance};
use model::spatial::Pose;
use nalgebra::Vector3;
use report::{Grid, Ink, Scene, Stroke, number};
use rig::Rig;
use rig::model_file::Sensor;

use super::MOST_CHARTS;

/// An axis on the arm is this share of the arm's reach to either side.
const AXIS_SHARE: f64 = 0.14;
const NOMINAL: Ink = Ink::Muted;
const ACTUAL: Ink = Ink::Series(1);

/// The whole arm in the one of these poses (rad) that shows its sections best.
pub fn drawing(rig: &Rig, sensors: &[Sensor], poses_rad: &[&[f64]]) -> Scene {
    let scene = Scene::new("Sensing axes on the arm", 1060.0, 560.0);
    let seen = |pose: &&&[f64]| spread(&scene, rig, pose);
    let pose = poses_rad.iter().max_by(|a, b| seen(a).total_cmp(&seen(b))).copied().unwrap_or(&[]);
    let links = rig.chain.placements(pose);
    let mut scene =
        scene.remark("in one of the recorded poses; a dot marks the positive end of an actual axis");
    let mut body = vec![[0.0; 3]];
    body.extend(links.iter().map(|link| <[f64; 3]>::from(link.translation_m)));
    let reach_m: f64 = body.windows(2).map(|w| (Vector3::from(w[1]) - Vector3::from(w[0])).norm()).sum();
    let length_m = AXIS_SHARE * reach_m.max(1e-3);
    ground(&mut scene, 0.35 * reach_m);
    scene.line(&body, Ink::Series(0), Stroke::Body);
    body.iter().for_each(|point| scene.point(*point));
    for (section, sensor) in rig.sections.iter().zip(sensors) {
        let frame =
            links[section.joint].compose(&Pose { rotation: section.r_cs, translation_m: Vector3::zeros() });
        axes(&mut scene, &frame, actual(sensor), length_m);
        scene.name(frame.translation_m.into(), sensor.name.clone());
    }
    explain(&mut scene);
    scene
}

/// Each gauge's axes from near, all at one scale, seen against its nominal frame.
pub fn close_ups(sensors: &[Sensor]) -> Grid {
    let farthest = |f: ActualFrame| f.l_x_m.hypot(f.l_y_m);
    let half_m = 1.6 * sensors.iter().filter_map(actual).map(farthest).fold(0.01, f64::max);
    let origin = Pose::identity();
    sensors.iter().take(MOST_CHARTS).fold(Grid::default(), |grid, sensor| {
        let frame = actual(sensor);
        let remark = frame.map_or_else(
            || "not determined by these recordings".to_owned(),
            |f| {
                let tilt = f.axes()[(2, 2)].clamp(-1.0, 1.0).acos().to_degrees();
                let off_mm = 1e3 * farthest(f);
                format!("turned by {}\u{b0}, {} mm off", number(tilt, 3), number(off_mm, 2))
            },
        );
        let mut scene = Scene::new(sensor.name.clone(), 320.0, 250.0)
            .remark(remark)
            .from_direction(0.6, 0.5)
            .about_origin(half_m);
        ground(&mut scene, 0.6 * half_m);
        axes(&mut scene, &origin, frame, 0.8 * half_m);
        scene.point([0.0; 3]);
        let mm = number(600.0 * half_m, 2);
        scene.name([0.6 * half_m, 0.0, 0.0], format!("x, {mm} mm"));
        scene.name([0.0, 0.6 * half_m, 0.0], "y");
        grid.with(scene)
    })
}

/// The actual frame as far as the calibration determined it.
fn actual(sensor: &Sensor) -> Option<ActualFrame> {
    sensor.frame.r_counts_per_nm?;
    Compliance::from_vector(&sensor.working()).actual_frame()
}

fn axes(scene: &mut Scene, frame: &Pose, actual: Option<ActualFrame>, length_m: f64) {
    let at = |point: Vector3<f64>| <[f64; 3]>::from(frame.translation_m + frame.rotation * point);
    scene.line(&[at(-Vector3::z() * length_m), at(Vector3::z() * length_m)], NOMINAL, Stroke::Dashed);
    let Some(actual) = actual else { return };
    let (point, direction) = actual.line();
    scene.line(&[at(Vector3::zeros()), at(point)], ACTUAL, Stroke::Dashed);
    scene.line(&[at(point - direction * length_m), at(point + direction * length_m)], ACTUAL, Stroke::Plain);
    scene.point(at(point + direction * length_m));
}

fn explain(scene: &mut Scene) {
    scene.explain("nominal axis", NOMINAL, Stroke::Dashed);
    scene.explain("actual axis", ACTUAL, Stroke::Plain);
    scene.explain("arm", Ink::Series(0), Stroke::Body);
}

/// A cross on the ground through the origin, x and y.
fn ground(scene: &mut Scene, half_m: f64) {
    scene.line(&[[-half_m, 0.0, 0.0], [half_m, 0.0, 0.0]], Ink::Muted, Stroke::Thin);
    scene.line(&[[0.0, -half_m, 0.0], [0.0, half_m, 0.0]], Ink::Muted, Stroke::Thin);
}

/// How far apart the nearest two sections at different places appear, m.
fn spread(scene: &Scene, rig: &Rig, pose_rad: &[f64]) -> f64 {
    let links = rig.chain.placements(pose_rad);
    let places: Vec<Vector3<f64>> = rig.sections.iter().map(|s| links[s.joint].translation_m).collect();
    let mut nearest = f64::INFINITY;
    for (k, a) in places.iter().enumerate() {
        for b in places[..k].iter().filter(|b| (*b - a).norm() > 1e-6) {
            nearest = nearest.min(scene.apparent_distance_m((*a).into(), (*b).into()));
        }
    }
    nearest
}
