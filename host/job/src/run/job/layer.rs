//! How a weld is made, in layers: every value may be given for the whole job, for a seam, and for a pass.
//!
//! A layer holds only what was said in it. What lies on top wins; what nobody said has a default.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::quantity::{
    AcrossMm, AirFeedMmS, AmplitudeMm, ApproachFeedMmS, ApproachMm, ClearanceMm, CornerRadiusMm, ExtendMm,
    FeedMmS, FrequencyHz, HeightMm, LeadMm, LiftMm, OutMm, PitchMm, Place, Points, SpacingMm, StandoffMm,
    StitchMm, Tacks, TimeS, TravelAngleDeg, TurnDeg, WavelengthMm, WithinMm, WorkAngleDeg,
};
use weldpath_method::seam::Joint;
use weldpath_method::weld::cornering::Cornering;
use weldpath_method::weld::program::Motion;
use weldpath_method::weld::recipe::Recipe;
use weldpath_method::weld::resampling::Sampling;
use weldpath_method::weld::stitching::{Pattern, Stitching};
use weldpath_method::weld::weave::{Shape, Weave};

/// Spacing of the waypoints when nothing else is said, mm.
const DEFAULT_SPACING_MM: f64 = 2.0;
/// Travel in one wave when nothing else is said, mm.
const DEFAULT_WAVELENGTH_MM: f64 = 4.0;

/// A layer: first the settings that have a default, then those that may stay unsaid.
macro_rules! layer {
    ($(#[$doc:meta])* $name:ident of $table:literal
        { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* } or { $($(#[$other_doc:meta])* $other:ident: $other_type:ty,)* }
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name {
            $($(#[$field_doc])* #[serde(skip_serializing_if = "Option::is_none")] pub $field: Option<$type>,)*
            $($(#[$other_doc])* #[serde(skip_serializing_if = "Option::is_none")] pub $other: Option<$other_type>,)*
        }

        impl $name {
            const TABLE: (&str, &[&str]) =
                ($table, &[$(stringify!($field),)* $(stringify!($other),)*]);

            /// What is said here, and what `below` says where nothing is.
            #[must_use]
            fn on(self, below: Self) -> Self {
                Self { $($field: self.$field.or(below.$field),)* $($other: self.$other.or(below.$other),)* }
            }

            /// With every default written out.
            #[must_use]
            fn filled(mut self) -> Self {
                $(self.$field = Some(self.$field.unwrap_or_default());)*
                self
            }

            fn is_empty(&self) -> bool {
                *self == Self::default()
            }
        }
    };
}

/// Which way a seam is welded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// Whichever makes the air way shorter.
    #[default]
    Free,
    /// As it was found.
    Forward,
    /// Against that.
    Reverse,
    /// Uphill; level seams are free.
    Up,
    /// Downhill; level seams are free.
    Down,
}

layer! {
    /// `[path]`: how the torch moves along a seam.
    PathSettings of "path" {
        /// Distance of the tip from the seam along the torch axis.
        standoff_mm: StandoffMm,
        /// Weld speed along the seam.
        feed_mm_s: FeedMmS,
        /// Which way the seam is welded.
        direction: Direction,
        /// Welded before the start; negative shortens. A closed seam overlaps itself.
        extend_start_mm: ExtendMm,
        /// Welded beyond the end; negative shortens. A closed seam overlaps itself.
        extend_end_mm: ExtendMm,
        /// Straight along the travel before the start, arc off.
        lead_in_mm: LeadMm,
        /// Straight along the travel beyond the end, arc off.
        lead_out_mm: LeadMm,
        /// Standing still with the arc on where it was struck.
        start_dwell_s: TimeS<0>,
        /// Standing still with the arc on where it is put out, beside `arc.crater_s`.
        end_dwell_s: TimeS<0>,
        /// What happens at corners.
        corner: Cornering,
        /// Radius of the arc in place of a corner.
        corner_radius_mm: CornerRadiusMm,
        /// Distance of the approach from the seam along the torch axis.
        approach_mm: ApproachMm,
        /// Speed from the approach to the seam, and off it.
        approach_feed_mm_s: ApproachFeedMmS,
        /// Speed of air moves.
        air_feed_mm_s: AirFeedMmS,
        /// How far the torch is lifted between stitches.
        lift_mm: LiftMm,
        /// Between the torch and the model on air moves; the greatest of all seams holds for all.
        clearance_mm: ClearanceMm,
    } or {
        /// Spacing of the waypoints; not together with `points`.
        spacing_mm: SpacingMm,
        /// Waypoints of each seam; not together with `spacing_mm`.
        points: Points,
        /// Distance of the retract from the seam, where it is not that of the approach.
        retract_mm: ApproachMm,
    }
}

layer! {
    /// `[torch]`: how the torch leans; zero is along the bisector of the faces, square to the travel.
    TorchSettings of "torch" {
        /// Lean to the right of the travel; negative to the left.
        work_angle_deg: WorkAngleDeg,
        /// Positive pushes (the wire points ahead), negative drags.
        travel_angle_deg: TravelAngleDeg,
        /// Turn about the torch axis, counter-clockwise for one who looks into the work.
        turn_deg: TurnDeg,
    } or {}
}

layer! {
    /// `[weave]`: how the tip swings about the seam.
    WeaveSettings of "weave" {
        /// How it swings.
        shape: Shape,
        /// From the seam to the farthest place on either side.
        amplitude_mm: AmplitudeMm,
        /// Standing still at the left of the travel.
        dwell_left_s: TimeS<0>,
        /// Standing still at the right of the travel.
        dwell_right_s: TimeS<0>,
    } or {
        /// Travel in one wave; not together with `frequency_hz`.
        wavelength_mm: WavelengthMm,
        /// Waves per second, dwell not counted; not together with `wavelength_mm`.
        frequency_hz: FrequencyHz,
        /// How far the sides of a triangle are out of the work, where it is not the amplitude.
        height_mm: HeightMm,
    }
}

layer! {
    /// `[stitch]`: which stretches of a seam are welded.
    StitchSettings of "stitch" {
        /// Which pattern.
        pattern: Pattern,
        /// Length of each stitch or tack.
        length_mm: StitchMm,
        /// From the centre of a stitch to the next.
        pitch_mm: PitchMm,
        /// How many tacks.
        count: Tacks,
    } or {}
}

/// `[[pass]]`: one run along the seam, and what it has of its own.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PassSettings {
    /// To the right of the seam's direction, also where the pass is reversed.
    pub across_mm: AcrossMm,
    /// Out of the work.
    pub out_mm: OutMm,
    /// Against the direction of the seam.
    pub reverse: bool,
    /// Over the seam's.
    #[serde(skip_serializing_if = "PathSettings::is_empty")]
    pub path: PathSettings,
    /// Over the seam's.
    #[serde(skip_serializing_if = "TorchSettings::is_empty")]
    pub torch: TorchSettings,
    /// Over the seam's.
    #[serde(skip_serializing_if = "WeaveSettings::is_empty")]
    pub weave: WeaveSettings,
    /// Over the seam's.
    #[serde(skip_serializing_if = "StitchSettings::is_empty")]
    pub stitch: StitchSettings,
}

// Of the whole job and of one seam it says the same: everything about how they are welded, in layers.
/// `[joint.TYPE]`: how all seams of one joint type are welded.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(rename = "JointSettings")]
pub struct Weld {
    /// Over the job's.
    #[serde(skip_serializing_if = "PathSettings::is_empty")]
    pub path: PathSettings,
    /// Over the job's.
    #[serde(skip_serializing_if = "TorchSettings::is_empty")]
    pub torch: TorchSettings,
    /// Over the job's.
    #[serde(skip_serializing_if = "WeaveSettings::is_empty")]
    pub weave: WeaveSettings,
    /// Over the job's.
    #[serde(skip_serializing_if = "StitchSettings::is_empty")]
    pub stitch: StitchSettings,
    /// In place of the job's, if there are any.
    #[serde(rename = "pass", skip_serializing_if = "Vec::is_empty")]
    pub passes: Vec<PassSettings>,
}

/// `[[seam]]`: what one seam has of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SeamSettings {
    /// The seam with this id; not together with `near_mm`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<usize>,
    /// The seam nearest to this place, mm, base frame; not together with `id`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near_mm: Option<Place>,
    /// The seam lies within this of `near_mm`; 200 mm by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub within_mm: Option<WithinMm>,
    /// Whether it is welded at all.
    #[serde(skip_serializing_if = "is_true")]
    pub weld: bool,
    /// Its joint type, where it is not the one that was found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<Joint>,
    /// Over those of its joint type.
    #[serde(skip_serializing_if = "PathSettings::is_empty")]
    pub path: PathSettings,
    /// Over those of its joint type.
    #[serde(skip_serializing_if = "TorchSettings::is_empty")]
    pub torch: TorchSettings,
    /// Over those of its joint type.
    #[serde(skip_serializing_if = "WeaveSettings::is_empty")]
    pub weave: WeaveSettings,
    /// Over those of its joint type.
    #[serde(skip_serializing_if = "StitchSettings::is_empty")]
    pub stitch: StitchSettings,
    /// In place of those, if there are any.
    #[serde(rename = "pass", skip_serializing_if = "Vec::is_empty")]
    pub passes: Vec<PassSettings>,
}

fn is_true(value: &bool) -> bool {
    *value
}

impl Default for SeamSettings {
    fn default() -> Self {
        Self {
            id: None,
            near_mm: None,
            within_mm: None,
            weld: true,
            joint: None,
            path: PathSettings::default(),
            torch: TorchSettings::default(),
            weave: WeaveSettings::default(),
            stitch: StitchSettings::default(),
            passes: Vec::new(),
        }
    }
}

impl SeamSettings {
    /// The layer alone.
    pub fn weld(&self) -> Weld {
        let (path, torch, weave, stitch) = (self.path, self.torch, self.weave, self.stitch);
        Weld { path, torch, weave, stitch, passes: self.passes.clone() }
    }
}

/// The table in which a key belongs.
pub(super) fn table_of(key: &str) -> Option<&'static str> {
    let tables = [PathSettings::TABLE, TorchSettings::TABLE, WeaveSettings::TABLE, StitchSettings::TABLE];
    tables.iter().find(|(_, keys)| keys.contains(&key)).map(|(table, _)| *table)
}

impl Weld {
    /// What is said here, and what `below` says where nothing is.
    #[must_use]
    pub fn on(&self, below: &Self) -> Self {
        let (mut path, mut weave) = (below.path, below.weave);
        // Two ways to say one thing: the upper layer's way holds.
        if self.path.spacing_mm.is_some() || self.path.points.is_some() {
            (path.spacing_mm, path.points) = (None, None);
        }
        if self.weave.wavelength_mm.is_some() || self.weave.frequency_hz.is_some() {
            (weave.wavelength_mm, weave.frequency_hz) = (None, None);
        }
        let passes = if self.passes.is_empty() { &below.passes } else { &self.passes };
        Self {
            path: self.path.on(path),
            torch: self.torch.on(below.torch),
            weave: self.weave.on(weave),
            stitch: self.stitch.on(below.stitch),
            passes: passes.clone(),
        }
    }

    /// With every default written out.
    #[must_use]
    pub fn filled(&self) -> Self {
        let mut path = self.path.filled();
        if let Sampling::SpacingMm(spacing_mm) = self.sampling() {
            path.spacing_mm = spacing_mm.try_into().ok();
        }
        let mut weave = self.weave.filled();
        if weave.frequency_hz.is_none() {
            weave.wavelength_mm = weave.wavelength_mm.or(DEFAULT_WAVELENGTH_MM.try_into().ok());
        }
        let (torch, stitch) = (self.torch.filled(), self.stitch.filled());
        Self { path, torch, weave, stitch, passes: self.passes.clone() }
    }

    /// Which way the seam is welded.
    pub fn direction(&self) -> Direction {
        self.path.direction.unwrap_or_default()
    }

    /// One recipe and motion for each pass.
    pub fn passes(&self) -> Vec<(Recipe, Motion)> {
        let plain = [PassSettings::default()];
        let passes = if self.passes.is_empty() { &plain } else { self.passes.as_slice() };
        let layered = |pass: &PassSettings| {
            let own = Self {
                path: pass.path,
                torch: pass.torch,
                weave: pass.weave,
                stitch: pass.stitch,
                passes: Vec::new(),
            };
            let weld = own.on(self);
            let recipe = Recipe {
                reverse: pass.reverse,
                across_mm: pass.across_mm.get(),
                out_mm: pass.out_mm.get(),
                ..weld.recipe()
            };
            (recipe, weld.motion())
        };
        passes.iter().map(layered).collect()
    }

    /// How densely the paths are sampled.
    pub fn sampling(&self) -> Sampling {
        match (self.path.points, self.path.spacing_mm) {
            (Some(points), _) => Sampling::Points(points.get() as usize),
            (None, spacing) => Sampling::SpacingMm(spacing.map_or(DEFAULT_SPACING_MM, SpacingMm::get)),
        }
    }

    /// How the torch moves.
    pub fn motion(&self) -> Motion {
        let path = &self.path;
        let approach_mm = path.approach_mm.unwrap_or_default().get();
        Motion {
            feed_mm_s: path.feed_mm_s.unwrap_or_default().get(),
            approach_feed_mm_s: path.approach_feed_mm_s.unwrap_or_default().get(),
            air_feed_mm_s: path.air_feed_mm_s.unwrap_or_default().get(),
            approach_mm,
            retract_mm: path.retract_mm.map_or(approach_mm, ApproachMm::get),
            lift_mm: path.lift_mm.unwrap_or_default().get(),
            clearance_mm: path.clearance_mm.unwrap_or_default().get(),
        }
    }

    fn recipe(&self) -> Recipe {
        let (path, torch) = (&self.path, &self.torch);
        Recipe {
            sampling: Some(self.sampling()),
            extend_start_mm: path.extend_start_mm.unwrap_or_default().get(),
            extend_end_mm: path.extend_end_mm.unwrap_or_default().get(),
            corner: path.corner.unwrap_or_default(),
            corner_radius_mm: path.corner_radius_mm.unwrap_or_default().get(),
            weave: self.weave(),
            work_angle_rad: torch.work_angle_deg.unwrap_or_default().get().to_radians(),
            travel_angle_rad: torch.travel_angle_deg.unwrap_or_default().get().to_radians(),
            turn_rad: torch.turn_deg.unwrap_or_default().get().to_radians(),
            standoff_mm: path.standoff_mm.unwrap_or_default().get(),
            stitch: self.stitching(),
            start_dwell_s: path.start_dwell_s.unwrap_or_default().get(),
            end_dwell_s: path.end_dwell_s.unwrap_or_default().get(),
            lead_in_mm: path.lead_in_mm.unwrap_or_default().get(),
            lead_out_mm: path.lead_out_mm.unwrap_or_default().get(),
            ..Recipe::default()
        }
    }

    fn weave(&self) -> Weave {
        let weave = &self.weave;
        let amplitude_mm = weave.amplitude_mm.unwrap_or_default().get();
        let wavelength_mm = match weave.frequency_hz {
            Some(frequency_hz) => self.motion().feed_mm_s / frequency_hz.get(),
            None => weave.wavelength_mm.map_or(DEFAULT_WAVELENGTH_MM, WavelengthMm::get),
        };
        Weave {
            shape: weave.shape.unwrap_or_default(),
            amplitude_mm,
            wavelength_mm,
            height_mm: weave.height_mm.map_or(amplitude_mm, HeightMm::get),
            dwell_left_s: weave.dwell_left_s.unwrap_or_default().get(),
            dwell_right_s: weave.dwell_right_s.unwrap_or_default().get(),
        }
    }

    fn stitching(&self) -> Stitching {
        let stitch = &self.stitch;
        Stitching {
            pattern: stitch.pattern.unwrap_or_default(),
            length_mm: stitch.length_mm.unwrap_or_default().get(),
            pitch_mm: stitch.pitch_mm.unwrap_or_default().get(),
            count: stitch.count.unwrap_or_default().get() as usize,
        }
    }
}
