//! Enums whose values have a name on the command line and in files.

/// The enum, all of its values, their names, and the value of a name.
macro_rules! named {
    ($what:literal: $(#[$about:meta])* pub enum $kind:ident { $($(#[$doc:meta])* $value:ident = $name:literal,)* }) => {
        $(#[$about])*
        pub enum $kind {
            $($(#[$doc])* $value,)*
        }

        impl $kind {
            /// All of them.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$value),*];

            /// The name on the command line and in files.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name,)*
                }
            }
        }

        impl std::fmt::Display for $kind {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.name())
            }
        }

        impl std::str::FromStr for $kind {
            type Err = $crate::simulation::Error;

            fn from_str(word: &str) -> Result<Self, Self::Err> {
                let choices = || Self::ALL.map(Self::name).join(", ");
                let found = Self::ALL.into_iter().find(|one| one.name() == word);
                found.ok_or_else(|| Self::Err::Unknown { what: $what, word: word.into(), choices: choices() })
            }
        }
    };
}

pub(super) use named;
