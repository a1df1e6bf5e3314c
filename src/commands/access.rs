//! Access to a server: its tokens and its audit log. Tokens are managed over HTTP or directly in the
//! database. Anybody who can write to the database needs no token.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use reports::{Align, Table};
use store::{Access, AuditEntry, Store, StoreError};
use wire::{CreatedToken, NewToken, Scope, Token, Tokens};

use crate::arguments::{
    AskArguments, ConfigArguments, OutputArguments, ServerArguments, StoreArguments, token_name,
};
use crate::client::Client;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Create a token and print it, only this once
    Create(Create),
    /// List tokens, including revoked and expired ones
    List(List),
    /// Revoke a token
    Revoke(Revoke),
    /// Delete all tokens, directly in the database; a server that is started afterwards requires
    /// none
    Clear(Clear),
}

/// The place of tokens.
#[derive(Debug, Args)]
struct Place {
    /// Write to the database instead of asking its server, for the first token or if none is left
    #[arg(long)]
    directly: bool,

    #[command(flatten)]
    server: ServerArguments,

    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    store: StoreArguments,
}

#[derive(Debug, Args)]
struct Create {
    /// The name of its user: 1 to 100 letters, digits, dashes, underscores, dots and @
    #[arg(value_parser = token_name)]
    name: String,

    /// Scope of the token: read, submit (also jobs and recordings) or admin (everything)
    #[arg(long, default_value_t = Scope::Submit)]
    scope: Scope,

    /// Time until it expires, such as 90d or 12h [default: it does not expire]
    #[arg(long, value_name = "TIME", value_parser = lifetime)]
    expires: Option<Duration>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    place: Place,
}

#[derive(Debug, Args)]
struct List {
    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    place: Place,
}

#[derive(Debug, Args)]
struct Revoke {
    /// The token's name
    #[arg(value_parser = token_name)]
    name: String,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    place: Place,
}

#[derive(Debug, Args)]
struct Clear {
    #[command(flatten)]
    config: ConfigArguments,

    #[command(flatten)]
    store: StoreArguments,
}

/// The store of tokens: a server, or its database.
enum Keeper {
    Server(Client),
    Database(Box<api::App>, Store),
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    match arguments.command {
        Command::Create(arguments) => create(arguments).await?,
        Command::List(arguments) => list(arguments).await?,
        Command::Revoke(arguments) => revoke(arguments).await?,
        Command::Clear(arguments) => clear(&arguments.store).await?,
    }
    Ok(ExitCode::SUCCESS)
}

async fn create(arguments: Create) -> anyhow::Result<()> {
    let Create { name, scope, expires, output, place } = arguments;
    let token = NewToken { name, scope, expires_in_s: expires.map(|expires| expires.as_secs()) };
    let created = Keeper::at(&place).await?.create(&token).await?;
    if output.json {
        println!("{}", serde_json::to_string_pretty(&created)?);
        return Ok(());
    }
    // Prints only the token, for `TORQUED_TOKEN=$(torqued token create ana)`.
    println!("{}", created.secret);
    let until = created.token.expires_at.map(|at| format!(" until {at}")).unwrap_or_default();
    eprintln!("it lets {} {scope}{until}, and is not shown again", created.token.name);
    Ok(())
}

async fn list(arguments: List) -> anyhow::Result<()> {
    let tokens = Keeper::at(&arguments.place).await?.tokens().await?;
    if arguments.output.json {
        println!("{}", serde_json::to_string_pretty(&tokens)?);
        return Ok(());
    }
    if tokens.tokens.is_empty() {
        println!("no token; `torqued token create NAME --scope admin` creates the first one");
        return Ok(());
    }
    let mut table = Table::new([
        ("name", Align::Left),
        ("scope", Align::Left),
        ("state", Align::Left),
        ("created", Align::Left),
        ("expires", Align::Left),
        ("last used", Align::Left),
    ]);
    for token in tokens.tokens {
        let state = state(&token);
        table.push(vec![
            token.name,
            token.scope.to_string(),
            state.to_owned(),
            token.created_at,
            token.expires_at.unwrap_or_default(),
            token.last_used_at.unwrap_or_default(),
        ]);
    }
    print!("{}", table.render());
    Ok(())
}

fn state(token: &Token) -> &'static str {
    match (token.valid, &token.revoked_at) {
        (true, _) => "valid",
        (false, Some(_)) => "revoked",
        (false, None) => "expired",
    }
}

async fn revoke(arguments: Revoke) -> anyhow::Result<()> {
    let Revoke { name, output, place } = arguments;
    let keeper = Keeper::at(&place).await?;
    let tokens = keeper.tokens().await?.tokens;
    let named = tokens.iter().find(|token| token.name == name && token.revoked_at.is_none());
    let Some(token) = named else {
        bail!("there is no token {name}; `torqued token list` shows all");
    };
    let revoked = keeper.revoke(token.id).await?;
    if output.json {
        println!("{}", serde_json::to_string_pretty(&revoked)?);
    } else {
        println!("revoked {name}");
    }
    Ok(())
}

async fn clear(place: &StoreArguments) -> anyhow::Result<()> {
    let store = open(place).await?;
    let count = store.forget_tokens().await?;
    record(&store, "token clear", None).await?;
    store.close().await;
    println!("deleted {count} tokens; a running server requires one until it is restarted");
    Ok(())
}

impl Keeper {
    async fn at(place: &Place) -> anyhow::Result<Self> {
        if !place.directly {
            return Ok(Self::Server(place.server.client()?));
        }
        let store = open(&place.store).await?;
        let app = api::App::new(store.clone(), &api::Options::default());
        Ok(Self::Database(Box::new(app), store))
    }

    async fn tokens(&self) -> anyhow::Result<Tokens> {
        match self {
            Self::Server(client) => Ok(client.tokens().await?),
            Self::Database(app, _) => Ok(app.tokens().await?),
        }
    }

    async fn create(&self, token: &NewToken) -> anyhow::Result<CreatedToken> {
        match self {
            Self::Server(client) => Ok(client.create_token(token).await?),
            Self::Database(app, store) => {
                let created = app.create_token(token).await?;
                let made = format!("/v1/tokens/{}", created.token.id);
                record(store, &format!("token create {}", token.name), Some(made)).await?;
                Ok(created)
            }
        }
    }

    async fn revoke(&self, id: i64) -> anyhow::Result<Token> {
        match self {
            Self::Server(client) => Ok(client.revoke_token(id).await?),
            Self::Database(app, store) => {
                let token = app.revoke_token(id).await?;
                record(store, &format!("token revoke {}", token.name), None).await?;
                Ok(token)
            }
        }
    }
}

/// Opens the store beside its server, or creates it if there is none.
async fn open(place: &StoreArguments) -> anyhow::Result<Store> {
    let location = place.location();
    let store = match Store::open_at(&location, Access::Server).await {
        Err(StoreError::InUse { .. }) => Store::open_at(&location, Access::Worker).await,
        opened => opened,
    };
    store.with_context(|| format!("cannot open {location}"))
}

/// Adds an action without the server to the audit log.
async fn record(store: &Store, what: &str, made: Option<String>) -> anyhow::Result<()> {
    let user = nix::unistd::User::from_uid(nix::unistd::getuid()).ok().flatten();
    let user = user.map_or("somebody".to_owned(), |user| user.name);
    let entry = AuditEntry {
        actor: format!("{user} directly"),
        address: crate::process::host(),
        method: "torqued".to_owned(),
        path: what.to_owned(),
        status: 200,
        made,
    };
    Ok(store.record_audit(&entry).await?)
}

fn lifetime(text: &str) -> Result<Duration, String> {
    let (shortest, longest) = api::limits::TOKEN_LIFETIME_S;
    let time = humantime::parse_duration(text).ok();
    let time = time.filter(|time| (shortest..=longest).contains(&time.as_secs()));
    time.ok_or_else(|| "allowed: 1m to 3650d, for example 90d or 12h".to_owned())
}

/// Lists requests that changed something or were refused: who sent them, from where, and how they
/// were answered. It needs a token of scope admin.
#[derive(Debug, Args)]
pub struct AuditArguments {
    /// Only actions with the token of this name
    #[arg(long, value_name = "NAME", value_parser = token_name)]
    actor: Option<String>,

    /// Largest number of entries, 1 to 500
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=500))]
    limit: u32,

    #[command(flatten)]
    ask: AskArguments,
}

pub async fn audit(arguments: AuditArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.ask.client()?;
    let actor = arguments.actor.map(|name| format!("&actor={name}")).unwrap_or_default();
    let path = format!("/v1/audit?limit={}{actor}", arguments.limit);
    if arguments.ask.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let audit = client.audit(&path).await?;
    let mut table = Table::new([
        ("when", Align::Left),
        ("who", Align::Left),
        ("from", Align::Left),
        ("did", Align::Left),
        ("answer", Align::Right),
        ("made", Align::Left),
    ]);
    for entry in audit.entries {
        table.push(vec![
            entry.at,
            entry.actor,
            entry.address,
            format!("{} {}", entry.method, entry.path),
            entry.status.to_string(),
            entry.made.unwrap_or_default(),
        ]);
    }
    print!("{}", table.render());
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lifetime_has_a_unit_and_bounds() {
        assert_eq!(lifetime("90d"), Ok(Duration::from_secs(90 * 24 * 60 * 60)));
        for wrong in ["", "90", "59s", "3651d", "-1d", "soon"] {
            assert!(lifetime(wrong).is_err(), "{wrong}");
        }
    }
}
