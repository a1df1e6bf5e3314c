use std::time::Duration;

use spec::Digest;
use store::{AuditEntry, NewToken, Page, Scope, StoreError, Token, TokenId};

use super::Fixture;

fn asked(name: &str, scope: Scope) -> NewToken<'_> {
    NewToken {
        name,
        digest: Digest::of(name.as_bytes()),
        scope,
        lifetime: None,
        needs_an_admin: true,
    }
}

async fn create(f: &Fixture, token: &NewToken<'_>) -> Token {
    f.store.create_token(token).await.unwrap()
}

pub async fn a_token_is_listed_with_its_scope_until_it_is_revoked_and_after(f: Fixture) {
    let ana = create(&f, &asked("ana", Scope::Admin)).await;
    let ben = create(&f, &asked("ben", Scope::Read)).await;
    assert_eq!((ben.scope, ben.is_valid, ben.revoked_at), (Scope::Read, true, None));
    assert_eq!(f.store.tokens().await.unwrap(), [ana.clone(), ben.clone()]);
    let revoked = f.store.revoke_token(ben.id).await.unwrap();
    assert!(!revoked.is_valid && revoked.revoked_at.is_some());
    let again = f.store.revoke_token(ben.id).await.unwrap();
    assert_eq!(again, revoked, "it was revoked before");
    assert_eq!(f.store.tokens().await.unwrap(), [ana, revoked]);
    let missing = f.store.revoke_token(TokenId(99)).await.unwrap_err();
    assert!(matches!(missing, StoreError::NotFound { .. }), "{missing}");
}

pub async fn a_name_belongs_to_one_token_that_is_not_revoked(f: Fixture) {
    let first = create(&f, &asked("ana", Scope::Admin)).await;
    let other = NewToken { digest: Digest::of(b"another"), ..asked("ana", Scope::Read) };
    let taken = f.store.create_token(&other).await.unwrap_err();
    assert!(matches!(&taken, StoreError::TokenExists { name } if name == "ana"), "{taken}");
    f.store.revoke_token(first.id).await.unwrap();
    let other = NewToken { scope: Scope::Admin, ..other };
    assert_eq!(create(&f, &other).await.name, "ana");
}

pub async fn the_first_token_is_an_admins_unless_there_is_another(f: Fixture) {
    let early = f.store.create_token(&asked("ben", Scope::Submit)).await.unwrap_err();
    assert!(matches!(early, StoreError::FirstToken { scope: Scope::Submit }), "{early}");
    assert!(f.store.tokens().await.unwrap().is_empty());
    let elsewhere = NewToken { needs_an_admin: false, ..asked("ben", Scope::Submit) };
    create(&f, &elsewhere).await;
    let admin = create(&f, &asked("ana", Scope::Admin)).await;
    create(&f, &asked("cem", Scope::Read)).await;
    f.store.revoke_token(admin.id).await.unwrap();
    assert!(f.store.create_token(&asked("dan", Scope::Read)).await.is_err());
}

pub async fn a_token_expires(f: Fixture) {
    let brief = NewToken { lifetime: Some(Duration::from_millis(1)), ..asked("ana", Scope::Admin) };
    let token = create(&f, &brief).await;
    let lasts = token.expires_at.unwrap().milliseconds() - token.created_at.milliseconds();
    assert_eq!(lasts, 1);
    tokio::time::sleep(Duration::from_millis(5)).await;
    let [token] = &f.store.tokens().await.unwrap()[..] else { panic!("one token") };
    assert!(!token.is_valid && token.revoked_at.is_none());
}

pub async fn the_last_use_of_a_token_is_known(f: Fixture) {
    let token = create(&f, &asked("ana", Scope::Admin)).await;
    assert_eq!(token.last_used_at, None);
    f.store.token_used(token.id).await.unwrap();
    assert!(f.store.tokens().await.unwrap()[0].last_used_at >= Some(token.created_at));
}

pub async fn a_session_leads_to_its_token_until_it_ends(f: Fixture) {
    let token = Digest::of(b"token");
    let [lasting, brief, closed] = [b"a", b"b", b"c"].map(|name| Digest::of(name));
    let hour = Duration::from_secs(3600);
    f.store.open_session(lasting, token, hour).await.unwrap();
    f.store.open_session(brief, token, Duration::from_millis(1)).await.unwrap();
    f.store.open_session(closed, token, hour).await.unwrap();
    f.store.close_session(closed).await.unwrap();
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(f.store.session(lasting).await.unwrap(), Some(token));
    for ended in [brief, closed, Digest::of(b"never")] {
        assert_eq!(f.store.session(ended).await.unwrap(), None);
    }
}

pub async fn forgotten_tokens_leave_no_session(f: Fixture) {
    create(&f, &asked("ana", Scope::Admin)).await;
    let session = Digest::of(b"session");
    f.store.open_session(session, Digest::of(b"ana"), Duration::from_secs(60)).await.unwrap();
    assert_eq!(f.store.forget_tokens().await.unwrap(), 1);
    assert!(f.store.tokens().await.unwrap().is_empty());
    assert_eq!(f.store.session(session).await.unwrap(), None);
}

pub async fn the_audit_log_is_read_page_by_page_and_by_actor(f: Fixture) {
    let entry = |actor: &str, path: &str| AuditEntry {
        actor: actor.to_owned(),
        address: "127.0.0.1".to_owned(),
        method: "POST".to_owned(),
        path: path.to_owned(),
        status: 201,
        made: Some("/v1/jobs/1".to_owned()),
    };
    let written = [entry("ana", "/v1/jobs"), entry("ben", "/v1/jobs/1/cancel"), entry("ana", "/x")];
    for entry in &written {
        f.store.record_audit(entry).await.unwrap();
    }
    let [ana, ben, last] = written;
    let page = Page { before: None, limit: 2 };
    let newest = f.store.audit(None, page).await.unwrap();
    assert_eq!(newest.iter().map(|record| &record.entry).collect::<Vec<_>>(), [&last, &ben]);
    let page = Page { before: Some(newest[1].id), limit: 2 };
    let older = f.store.audit(None, page).await.unwrap();
    assert_eq!(older.iter().map(|record| &record.entry).collect::<Vec<_>>(), [&ana]);
    let of_ana = f.store.audit(Some("ana"), Page::default()).await.unwrap();
    assert_eq!(of_ana.iter().map(|record| &record.entry).collect::<Vec<_>>(), [&last, &ana]);
}
