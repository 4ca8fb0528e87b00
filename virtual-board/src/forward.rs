//! Writes methods that only call the same method of a field.

/// The methods of `field`, or those of a trait `for` it. All take `&self`, or all take `&mut self`.
macro_rules! forward {
    ($field:ident: $(fn $name:ident(&self $(, $arg:ident: $type:ty)*) $(-> $out:ty)?;)*) => {
        $(fn $name(&self $(, $arg: $type)*) $(-> $out)? { self.$field.$name($($arg),*) })*
    };
    ($field:ident: $(fn $name:ident(&mut self $(, $arg:ident: $type:ty)*) $(-> $out:ty)?;)*) => {
        $(fn $name(&mut self $(, $arg: $type)*) $(-> $out)? { self.$field.$name($($arg),*) })*
    };
    ($of:ident for $field:ident:
        $(fn $name:ident(&self $(, $arg:ident: $type:ty)*) $(-> $out:ty)?;)*) => {
        $(fn $name(&self $(, $arg: $type)*) $(-> $out)? { $of::$name(&self.$field $(, $arg)*) })*
    };
    ($of:ident for $field:ident:
        $(fn $name:ident(&mut self $(, $arg:ident: $type:ty)*) $(-> $out:ty)?;)*) => {
        $(fn $name(&mut self $(, $arg: $type)*) $(-> $out)? { $of::$name(&mut self.$field $(, $arg)*) })*
    };
}

pub(crate) use forward;
