//! SIGINT and SIGTERM: the first asks for an orderly end, the second ends at once. SIGHUP asks for
//! the configuration to be read again. On Windows Ctrl-C, Ctrl-Break, a closed console and a
//! shutdown ask for an orderly end; a new configuration needs a new start there.

use gearwatch_daemon::service::Reload;
use gearwatch_runtime::stop::Stop;

/// Gives `stop` at the first SIGINT or SIGTERM, and exits at the second with 128 + the signal's
/// number. Asks for `reload` at SIGHUP.
///
/// # Errors
/// When the system gives no thread or no signal handler.
pub fn listen(stop: &Stop, reload: &Reload) -> std::io::Result<()> {
    let (stop, reload) = (stop.clone(), reload.clone());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (ready, is_ready) = std::sync::mpsc::channel();
    std::thread::Builder::new().name("gw-signals".to_owned()).spawn(move || {
        // Nobody else hears signals: without this thread the service could not be told to stop.
        let _guard = ExitOnPanic;
        runtime.block_on(async {
            let waiting = Signals::new();
            let opened = waiting.as_ref().map(|_| ()).map_err(|e| std::io::Error::from(e.kind()));
            let _ = ready.send(opened);
            let Ok(mut signals) = waiting else { return };
            let name = signals.next(&reload).await.0;
            tracing::info!("{name}: stopping; once more to end at once");
            stop.now();
            let (_, number) = signals.next(&reload).await;
            std::process::exit(128 + number);
        });
    })?;
    is_ready.recv().unwrap_or(Ok(()))
}

/// Ends the process when the thread that holds it panics.
struct ExitOnPanic;

impl Drop for ExitOnPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            std::process::exit(70);
        }
    }
}

#[cfg(unix)]
struct Signals {
    interrupt: tokio::signal::unix::Signal,
    terminate: tokio::signal::unix::Signal,
    hangup: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl Signals {
    fn new() -> std::io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
            hangup: signal(SignalKind::hangup())?,
        })
    }

    /// The next signal to end.
    async fn next(&mut self, reload: &Reload) -> (&'static str, i32) {
        loop {
            tokio::select! {
                _ = self.interrupt.recv() => return ("SIGINT", 2),
                _ = self.terminate.recv() => return ("SIGTERM", 15),
                _ = self.hangup.recv() => reload.ask(),
            }
        }
    }
}

#[cfg(windows)]
struct Signals {
    interrupt: tokio::signal::windows::CtrlC,
    cut: tokio::signal::windows::CtrlBreak,
    close: tokio::signal::windows::CtrlClose,
    shutdown: tokio::signal::windows::CtrlShutdown,
}

#[cfg(windows)]
impl Signals {
    fn new() -> std::io::Result<Self> {
        use tokio::signal::windows::{ctrl_break, ctrl_c, ctrl_close, ctrl_shutdown};
        Ok(Self { interrupt: ctrl_c()?, cut: ctrl_break()?, close: ctrl_close()?, shutdown: ctrl_shutdown()? })
    }

    /// The next wish to end.
    async fn next(&mut self, _: &Reload) -> (&'static str, i32) {
        tokio::select! {
            _ = self.interrupt.recv() => ("Ctrl-C", 2),
            _ = self.cut.recv() => ("Ctrl-Break", 2),
            _ = self.close.recv() => ("the console closes", 15),
            _ = self.shutdown.recv() => ("the system shuts down", 15),
        }
    }
}
