//! The machine that figures were made on.

use crate::report::Machine;

impl Machine {
    /// This one, not calibrated.
    pub fn this() -> Self {
        Self { cpu: cpu_name(), threads: rayon::current_num_threads(), calibration: None }
    }
}

/// What the processor calls itself, where Linux knows it.
pub(crate) fn cpu_name() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let (_, name) =
        text.lines().filter_map(|line| line.split_once(':')).find(|(key, _)| key.trim_end() == "model name")?;
    Some(name.trim().to_owned())
}

/// High-water mark of the resident set, which Linux keeps.
pub(crate) fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// Lowers the high-water mark to what is in use now, where the system lets it; else the mark goes on from where it was.
pub(crate) fn forget_peak_memory() {
    // "5" is what Linux resets the mark by (proc_pid_clear_refs(5)). What fails here makes figures larger, not wrong edits.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
