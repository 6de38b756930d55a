//! States and causes of a verdict: each is an enum whose variants have a code for files and a
//! meaning for readers.

/// A value that files hold as a code.
pub trait Code: Copy + PartialEq + 'static {
    /// All values, in the order of the documentation.
    const ALL: &'static [Self];

    /// As written in JSON.
    fn code(self) -> &'static str;

    /// What it means, in one sentence or two.
    fn meaning(self) -> &'static str;

    /// The value of a code; `None` where no value has it.
    fn of_code(code: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|value| value.code() == code)
    }
}

/// Defines an enum together with the code and the meaning of each variant; the meaning is the
/// variant's documentation. A crate that uses it has `serde`.
#[macro_export]
macro_rules! codes {
    (
        $(#[$of_type:meta])*
        pub enum $name:ident, default $default:ident {
            $( $(#[doc = $meaning:literal])+ $variant:ident = $code:literal, )+
        }
    ) => {
        $(#[$of_type])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum $name {
            $( $(#[doc = $meaning])+ $variant, )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self::$default
            }
        }

        impl $name {
            /// As written in JSON.
            pub const fn code(self) -> &'static str {
                match self {
                    $( Self::$variant => $code, )+
                }
            }
        }

        impl serde::Serialize for $name {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.code())
            }
        }

        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let code = <std::borrow::Cow<'de, str> as serde::Deserialize<'de>>::deserialize(deserializer)?;
                let unknown = || serde::de::Error::unknown_variant(&code, &[$( $code, )+]);
                <Self as $crate::verdict::Code>::of_code(&code).ok_or_else(unknown)
            }
        }

        impl $crate::verdict::Code for $name {
            const ALL: &'static [Self] = &[$( Self::$variant, )+];

            fn code(self) -> &'static str {
                self.code()
            }

            fn meaning(self) -> &'static str {
                match self {
                    $( Self::$variant => concat!($($meaning),+).trim_start(), )+
                }
            }
        }
    };
}

codes! {
    /// Rank code of one harmonic. `Unknown` is outside 0…V and never means normal.
    pub enum Rank, default Unknown {
        /// Not judged: no baseline here, or the instrument is not all right.
        Unknown = "unknown",
        /// |deviation| < 1 %.
        Zero = "0",
        /// 1 % ≤ |deviation| < 4 %.
        I = "I",
        /// 4 % ≤ |deviation| < 7 %.
        II = "II",
        /// 7 % ≤ |deviation| < 10 %.
        III = "III",
        /// 10 % ≤ |deviation| < 13 %.
        IV = "IV",
        /// |deviation| ≥ 13 %.
        V = "V",
    }
}

impl Rank {
    /// All ranks that a deviation can have, in order.
    pub const KNOWN: [Self; 6] = [Self::Zero, Self::I, Self::II, Self::III, Self::IV, Self::V];

    /// 0 to 5 for plots, −1 where unknown.
    pub const fn level(self) -> i8 {
        match self {
            Self::Unknown => -1,
            Self::Zero => 0,
            Self::I => 1,
            Self::II => 2,
            Self::III => 3,
            Self::IV => 4,
            Self::V => 5,
        }
    }
}

codes! {
    /// State of the machine as far as this window tells. Each is given only where the data resolve
    /// it.
    pub enum MachineState, default Unknown {
        /// Not judged, or not resolved; `reason` says which.
        Unknown = "unknown",
        /// No harmonic deviates, and in each one that was judged rank IV or V is less probable than
        /// not.
        Normal = "normal",
        /// A deviation proven to be of rank I or more, but not of rank IV.
        Deviating = "deviating",
        /// A deviation proven to be of rank IV or V.
        Alarm = "alarm",
        /// Floor and harmonics moved together: the path from gear to sensor changed, not the gear.
        PathChanged = "path_changed",
    }
}

codes! {
    /// State of the instrument. Anything but `Ok` makes the rank unknown.
    pub enum InstrumentState, default Ok {
        /// Nothing is known to be wrong.
        Ok = "ok",
        /// The source said so, or samples pile up at the largest value.
        Overload = "overload",
        /// One value stands for an eighth of the window or more.
        FlatLine = "flat_line",
        /// The signal hardly ever changes: no line of the machine is in it.
        ChannelDead = "channel_dead",
        /// Values or whole blocks come several times: a staircase, or a buffer that was delivered
        /// twice.
        SamplesRepeated = "samples_repeated",
        /// The converter has too few codes in use to show a line as large as it is.
        QuantisationCoarse = "quantisation_coarse",
        /// NaN or infinite samples.
        NotFinite = "not_finite",
        /// Filters or transducer supply are still settling.
        Settling = "settling",
        /// The source declared the samples invalid, or a cable or transducer fault.
        SensorFault = "sensor_fault",
        /// The shaft speed could not be found to the accuracy that ranks need.
        NoSpeed = "no_speed",
        /// A mesh harmonic lies above the usable band of the recording.
        OutOfBand = "out_of_band",
        /// Sample rate or time stamps contradict each other.
        ClockTrouble = "clock_trouble",
        /// The offset of the signal is far larger than its alternating part.
        Bias = "bias",
        /// Hardly anything but the mains is in the signal: an open input.
        MainsHum = "mains_hum",
    }
}

codes! {
    /// Why the machine's state is unknown.
    pub enum Reason, default None {
        /// The state is known.
        None = "",
        /// The instrument is not all right.
        Instrument = "instrument",
        /// There is no baseline.
        NoBaseline = "no_baseline",
        /// The baseline does not know this channel.
        ChannelNotInBaseline = "channel_not_in_baseline",
        /// The baseline knows this channel in another unit.
        OtherUnit = "other_unit",
        /// The baseline has not seen this speed and torque.
        OutsideBaseline = "outside_baseline",
        /// The torque at the brake is not stated, and the baseline tells loads apart by it.
        TorqueMissing = "torque_missing",
        /// The baseline has too few windows here to say how much a healthy machine scatters.
        BaselineTooSmall = "baseline_too_small",
        /// The lines deviate, and so do the floors beside them: too little is known to say whether
        /// the gear or the path to the sensor changed.
        PathOrGear = "path_or_gear",
        /// Neither a deviation nor its absence is resolved: the healthy scatter is as wide as the
        /// rank steps.
        NotResolved = "not_resolved",
    }
}

codes! {
    /// How the signature table answers to the deviations.
    pub enum StateFit, default NotCompared {
        /// Not compared: the machine's state is unknown, or the path changed.
        NotCompared = "not_compared",
        /// One state holds 95 % of the probability and agrees with the deviations.
        One = "one",
        /// It takes several states to hold 95 % of the probability: they fit about equally.
        Several = "several",
        /// No state of the table agrees with the deviations.
        None = "none",
    }
}
