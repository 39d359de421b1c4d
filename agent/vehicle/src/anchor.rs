//! Where this vehicle was at one point of its odometry, as it was told: what its own estimate, and everybody else's of it,
//! may be tied to the world by. A pose that was estimated, or read from a checkpoint, is none.

use skein_estimation::odometry::OdometryPoint;
use skein_estimation::time::Span;
use skein_proto::anchor;

use crate::told_pose::ToldPose;
use crate::translate;

/// A told pose, tied to the odometry of its instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Anchor {
    pub(crate) point: OdometryPoint,
    pub(crate) told: ToldPose,
}

impl Anchor {
    /// The vehicle was told where it was at `point`. Who is told again before odometry went on is told a moment later,
    /// since others know an anchor by its time.
    pub(crate) fn new(mut point: OdometryPoint, told: ToldPose, before: Option<&Self>) -> Self {
        const MOMENT: Span = Span::from_nanos(1);
        if let Some(before) = before {
            point.taken = point.taken.max(before.point.taken + MOMENT);
        }
        Self { point, told }
    }

    /// One that was told before.
    pub(crate) const fn of(point: OdometryPoint, told: ToldPose) -> Self {
        Self { point, told }
    }

    /// As it crosses the wire.
    pub(crate) fn to_wire(self) -> anchor::Anchor {
        anchor::Anchor {
            taken_ns: self.point.taken.as_nanos(),
            segment: self.point.segment,
            odometry_from_body: self.point.odometry_from_body.to_numbers(),
            growth: translate::growth_to_wire(&self.point.growth),
            world_from_body: self.told.world_from_body.to_numbers(),
            rotation_sigma_rad: translate::sigma(self.told.rotation_sigma_rad),
            translation_sigma_m: translate::sigma(self.told.translation_sigma_m),
        }
    }
}
