//! Where odometry alone says the vehicle is, and the correction that makes it an estimate.
//!
//! The estimate is held as `correction * odometry`: a solution replaces the correction, so a round that is solved late
//! moves the present without replaying it.

use nalgebra::Vector3;
use skein_estimation::odometry::{Gap, Growth, OdometryPoint, Track};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Odometry, Sensor, Transform, World, se3};
use skein_proto::estimate::Velocity;
use skein_proto::frame::OdometryFrame;
use skein_proto::name::Name;

use crate::anchor::Anchor;
use crate::config::Start;
use crate::refused::Refused;
use crate::told_pose::ToldPose;
use crate::translate;

/// Increments that miss or overlap each other by no more than this follow each other.
const SEAM_MAX: Span = Span::millis(1);
/// Longest gap that is bridged at the speed that comes after it.
pub(crate) const BRIDGE_MAX: Span = Span::secs(1);

/// The vehicle's odometry and its correction.
#[derive(Clone, Debug)]
pub(crate) struct DeadReckoning {
    track: Track,
    source: Option<Name>,
    start: Start,
    correction: Option<Correction>,
    /// Where it was told to be, in the present segment.
    anchor: Option<Anchor>,
    velocity: Option<BodyVelocity>,
    interrupted: Option<Span>,
    /// The clock was set back by so much since the newest odometry.
    set_back: Option<Span>,
}

/// What makes odometry an estimate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Correction {
    world_from_odometry: Transform<World, Odometry>,
    segment: u8,
    footing: Footing,
}

/// What a pose rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Footing {
    /// A start pose, or what was measured since.
    Placed,
    /// A checkpoint: the vehicle may have been moved meanwhile. Good to be shown, never to be told or built on.
    Resumed,
}

#[derive(Clone, Copy, Debug)]
struct BodyVelocity {
    linear_body_m_s: Vector3<f64>,
    angular_body_rad_s: Vector3<f64>,
}

impl Correction {
    /// The one by which the vehicle was at `world_from_body` at this point.
    pub(crate) fn placed(point: &OdometryPoint, world_from_body: Transform<World, Body>) -> Self {
        Self {
            world_from_odometry: world_from_body * point.odometry_from_body.inverse(),
            segment: point.segment,
            footing: Footing::Placed,
        }
    }

    /// The estimate at a point of odometry; none when odometry was interrupted since.
    pub(crate) fn pose_at(&self, point: &OdometryPoint) -> Option<Transform<World, Body>> {
        (self.segment == point.segment).then(|| self.world_from_odometry * point.odometry_from_body)
    }
}

impl DeadReckoning {
    pub(crate) const fn new(start: Start) -> Self {
        Self {
            track: Track::new(),
            source: None,
            start,
            correction: None,
            anchor: None,
            velocity: None,
            interrupted: None,
            set_back: None,
        }
    }

    /// Adds one increment. The first sensor that brings any is the source from then on.
    pub(crate) fn add(
        &mut self,
        sensor: Name,
        body_from_sensor: &Transform<Body, Sensor>,
        frame: &OdometryFrame,
    ) -> Result<(), Refused> {
        if *self.source.get_or_insert(sensor) != sensor {
            return Err(Refused::SecondOdometry);
        }
        let since = Stamp::from_nanos(frame.since_ns);
        let taken = Stamp::from_nanos(frame.taken_ns);
        let sensor_motion = translate::transform::<Sensor, Sensor>(&frame.motion)?;
        let motion = *body_from_sensor * sensor_motion * body_from_sensor.inverse();

        let newest = self
            .track
            .newest()
            .copied()
            .unwrap_or_else(|| self.begin(since));
        let gap = since - newest.taken;
        if gap < -SEAM_MAX || taken <= newest.taken {
            return Err(Refused::Overlap);
        }
        let mut segment = newest.segment;
        let mut pose = newest.odometry_from_body;
        let mut growth = newest.growth;
        let sensor_position =
            |pose: &Transform<Odometry, Body>| (*pose * *body_from_sensor).translation;
        let set_back = self.set_back.take();
        if let Some(lost) = set_back.or((gap > BRIDGE_MAX).then_some(gap)) {
            segment = segment.wrapping_add(1);
            self.anchor = None;
            self.interrupted = Some(lost);
        } else if gap > SEAM_MAX {
            // The speed that comes after the gap is taken for the speed within; all of that motion may be wrong.
            let share = gap.as_secs_f64() / (taken - since).as_secs_f64();
            let twist = se3::log(&motion) * share;
            pose = pose * se3::exp(&twist);
            let turned = twist.fixed_rows::<3>(0).norm() + frame.rotation_sigma_rad * share;
            let moved = twist.fixed_rows::<3>(3).norm() + frame.translation_sigma_m * share;
            growth = growth.after(&sensor_position(&pose), turned, moved);
        }
        pose = pose * motion;
        growth = growth.after(
            &sensor_position(&pose),
            frame.rotation_sigma_rad,
            frame.translation_sigma_m,
        );
        self.track.insert(OdometryPoint {
            taken,
            segment,
            odometry_from_body: pose,
            growth,
        });

        let rate = se3::log(&motion) / (taken - since).as_secs_f64();
        self.velocity = Some(BodyVelocity {
            angular_body_rad_s: rate.fixed_rows::<3>(0).into(),
            linear_body_m_s: rate.fixed_rows::<3>(3).into(),
        });
        Ok(())
    }

    /// The first odometry: the body is where it starts.
    fn begin(&mut self, since: Stamp) -> OdometryPoint {
        let point = OdometryPoint {
            taken: since,
            segment: 0,
            odometry_from_body: Transform::identity(),
            growth: Growth::zero(),
        };
        self.track.insert(point);
        match self.start {
            Start::Pose(told) => self.be_told(&point, told),
            Start::Checkpoint(checkpoint) => {
                self.lay(&point, checkpoint.world_from_body, Footing::Resumed);
            }
            Start::Unknown => {}
        }
        point
    }

    /// The vehicle is here now: at the newest odometry, or at the first when none has come.
    pub(crate) fn set_pose(&mut self, told: ToldPose) {
        match self.newest().copied() {
            Some(newest) => self.be_told(&newest, told),
            None => self.start = Start::Pose(told),
        }
    }

    fn be_told(&mut self, point: &OdometryPoint, told: ToldPose) {
        self.anchor = Some(Anchor::new(*point, told, self.anchor.as_ref()));
        self.correct(point, told.world_from_body);
    }

    /// Where the vehicle was told to be, while odometry goes on from there.
    pub(crate) const fn anchor(&self) -> Option<&Anchor> {
        self.anchor.as_ref()
    }

    /// Nobody knows how the vehicle moves for so long: what odometry comes next does not go on from what came before.
    pub(crate) fn interrupt(&mut self, lost: Span) {
        self.set_back = self.set_back.max(Some(lost));
    }

    /// Odometry at an instant.
    pub(crate) fn at(&self, instant: Stamp) -> Result<OdometryPoint, Gap> {
        self.track.at(instant)
    }

    /// Odometry at an instant, which may lie a little past the newest.
    pub(crate) fn near(&self, instant: Stamp) -> Result<OdometryPoint, Gap> {
        self.track.near(instant)
    }

    pub(crate) fn newest(&self) -> Option<&OdometryPoint> {
        self.track.newest()
    }

    /// The estimate at a point of odometry, as it may be told and built on; none while the vehicle is unplaced, resumes
    /// from a checkpoint, or odometry was interrupted since.
    pub(crate) fn placed_at(&self, point: &OdometryPoint) -> Option<Transform<World, Body>> {
        self.pose_at(point).filter(|_| !self.is_resuming())
    }

    /// Whether the pose is that of a checkpoint, not yet confirmed.
    pub(crate) fn is_resuming(&self) -> bool {
        match &self.correction {
            Some(correction) => correction.footing == Footing::Resumed,
            None => matches!(self.start, Start::Checkpoint(_)),
        }
    }

    /// The estimate at a point of odometry, to be shown; none while the vehicle is unplaced or odometry was interrupted
    /// since.
    pub(crate) fn pose_at(&self, point: &OdometryPoint) -> Option<Transform<World, Body>> {
        self.correction?.pose_at(point)
    }

    /// From now on the estimate is such that it was `world_from_body` at this point.
    pub(crate) fn correct(
        &mut self,
        point: &OdometryPoint,
        world_from_body: Transform<World, Body>,
    ) {
        self.lay(point, world_from_body, Footing::Placed);
    }

    fn lay(
        &mut self,
        point: &OdometryPoint,
        world_from_body: Transform<World, Body>,
        footing: Footing,
    ) {
        self.correction = Some(Correction {
            footing,
            ..Correction::placed(point, world_from_body)
        });
        self.interrupted = None;
    }

    /// Whether there ever was a pose.
    pub(crate) const fn was_placed(&self) -> bool {
        self.correction.is_some()
    }

    /// How long the interruption was that cost the pose, if one did.
    pub(crate) const fn interrupted(&self) -> Option<Span> {
        self.interrupted
    }

    /// Velocity over the last increment, in a world in which the body stands so.
    pub(crate) fn velocity(&self, world_from_body: &Transform<World, Body>) -> Option<Velocity> {
        let velocity = self.velocity?;
        Some(Velocity {
            linear_world_m_s: (world_from_body.rotation * velocity.linear_body_m_s).into(),
            angular_body_rad_s: velocity.angular_body_rad_s.into(),
        })
    }
}

/// The motion of a body between two instants of one odometry: `body@later_from_body@earlier` whichever is later.
pub(crate) fn motion(to: &OdometryPoint, from: &OdometryPoint) -> Option<Transform<Body, Body>> {
    (to.segment == from.segment).then(|| to.odometry_from_body.inverse() * from.odometry_from_body)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint::Checkpoint;
    use nalgebra::UnitQuaternion;

    fn increment(since_ms: i64, taken_ms: i64, forward_m: f64) -> OdometryFrame {
        OdometryFrame {
            since_ns: since_ms * 1_000_000,
            taken_ns: taken_ms * 1_000_000,
            motion: [0.0, 0.0, 0.0, forward_m, 0.0, 0.0],
            rotation_sigma_rad: 0.01,
            translation_sigma_m: 0.01,
        }
    }

    fn wheels() -> Name {
        Name::parse("wheels").unwrap()
    }

    fn started() -> DeadReckoning {
        let start = Transform::new(UnitQuaternion::identity(), Vector3::new(10.0, 0.0, 0.0));
        DeadReckoning::new(Start::Pose(ToldPose::exact(start)))
    }

    fn x(reckoning: &DeadReckoning) -> f64 {
        reckoning
            .pose_at(reckoning.newest().unwrap())
            .unwrap()
            .translation
            .x
    }

    #[test]
    fn increments_add_up_from_the_start_pose() {
        let mut reckoning = started();
        reckoning
            .add(wheels(), &Transform::identity(), &increment(0, 100, 1.0))
            .unwrap();
        reckoning
            .add(wheels(), &Transform::identity(), &increment(100, 200, 0.5))
            .unwrap();
        assert!((x(&reckoning) - 11.5).abs() < 1e-12);
    }

    #[test]
    fn a_short_gap_is_bridged_and_a_long_one_loses_the_pose() {
        let mut reckoning = started();
        reckoning
            .add(wheels(), &Transform::identity(), &increment(0, 100, 1.0))
            .unwrap();
        reckoning
            .add(wheels(), &Transform::identity(), &increment(600, 700, 1.0))
            .unwrap();
        assert!((x(&reckoning) - 17.0).abs() < 1e-9, "0.5 s at 10 m/s");
        reckoning
            .add(
                wheels(),
                &Transform::identity(),
                &increment(1701, 1800, 1.0),
            )
            .unwrap();
        assert_eq!(reckoning.pose_at(reckoning.newest().unwrap()), None);
        assert_eq!(reckoning.interrupted(), Some(Span::millis(1001)));
    }

    #[test]
    fn the_anchor_is_where_the_vehicle_was_told_to_be_until_odometry_is_interrupted() {
        let mut reckoning = started();
        let add = |reckoning: &mut DeadReckoning, since_ms, taken_ms| {
            let frame = increment(since_ms, taken_ms, 1.0);
            let added = reckoning.add(wheels(), &Transform::identity(), &frame);
            added.unwrap();
        };
        assert_eq!(reckoning.anchor(), None, "no odometry yet to tie it to");
        add(&mut reckoning, 0, 100);
        let anchor = *reckoning.anchor().unwrap();
        assert_eq!(anchor.point.taken, Stamp::default());
        assert!((anchor.told.world_from_body.translation.x - 10.0).abs() < 1e-12);
        let newest = *reckoning.newest().unwrap();
        reckoning.correct(&newest, Transform::identity());
        assert_eq!(reckoning.anchor(), Some(&anchor), "an estimate is none");

        let there = ToldPose::by_hand(Transform::identity());
        reckoning.set_pose(there);
        let told = *reckoning.anchor().unwrap();
        assert_eq!((told.point, told.told), (newest, there));
        reckoning.set_pose(there);
        let again = reckoning.anchor().unwrap().point.taken;
        assert!(again > newest.taken, "others know it by its time");

        add(&mut reckoning, 2_000, 2_100);
        assert_eq!(reckoning.anchor(), None);
    }

    #[test]
    fn a_vehicle_that_resumes_or_is_placed_by_others_has_no_anchor() {
        let checkpoint = Checkpoint {
            boot: 1,
            taken: Stamp::default(),
            world_from_body: Transform::identity(),
        };
        for start in [Start::Unknown, Start::Checkpoint(checkpoint)] {
            let mut reckoning = DeadReckoning::new(start);
            let frame = increment(0, 100, 1.0);
            let added = reckoning.add(wheels(), &Transform::identity(), &frame);
            added.unwrap();
            let newest = *reckoning.newest().unwrap();
            reckoning.correct(&newest, Transform::identity());
            assert_eq!(reckoning.anchor(), None);
        }
    }

    #[test]
    fn overlapping_odometry_and_a_second_source_are_refused() {
        let mut reckoning = started();
        reckoning
            .add(wheels(), &Transform::identity(), &increment(0, 100, 1.0))
            .unwrap();
        let again = reckoning.add(wheels(), &Transform::identity(), &increment(50, 150, 1.0));
        assert_eq!(again, Err(Refused::Overlap));
        let other = Name::parse("camera").unwrap();
        let second = reckoning.add(other, &Transform::identity(), &increment(100, 200, 1.0));
        assert_eq!(second, Err(Refused::SecondOdometry));
    }

    #[test]
    fn odometry_of_a_sensor_beside_the_body_turns_about_the_body() {
        let mut reckoning = DeadReckoning::new(Start::Pose(ToldPose::exact(Transform::identity())));
        let mount = Transform::new(UnitQuaternion::identity(), Vector3::new(0.0, 1.0, 0.0));
        // A quarter turn about the body's origin moves a sensor at (0, 1) to (-1, 0): in its own frame by (-1, -1).
        let quarter = std::f64::consts::FRAC_PI_2;
        let frame = OdometryFrame {
            motion: [0.0, 0.0, quarter, -1.0, -1.0, 0.0],
            ..increment(0, 100, 0.0)
        };
        reckoning.add(wheels(), &mount, &frame).unwrap();
        let pose = reckoning.pose_at(reckoning.newest().unwrap()).unwrap();
        assert!(pose.translation.norm() < 1e-12, "{pose:?}");
    }
}
