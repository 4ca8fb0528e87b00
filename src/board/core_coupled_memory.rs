//! Clears the statics in core-coupled memory before anything else runs. cortex-m-rt calls this function, and
//! clears the statics in the other RAM only. memory.x gives both addresses, which are multiples of 4.

core::arch::global_asm!(include_str!("core_coupled_memory.s"));
