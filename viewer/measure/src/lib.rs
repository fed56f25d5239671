//! Measuring as a wasm module for a Web Worker: questions in, final values out, the same to the last digit as `kilwa measure` prints.
//!
//! JavaScript gives the bytes (`www/measure/engine.js` through the page's loader) and carries JSON; everything that is computed is
//! `kilwa_measure`'s. Several questions may be open at a time; each is cancelled by rejecting what it waits for.

pub mod question;
pub mod remote;
pub mod sheet;

use js_sys::{Function, Promise, Uint8Array};
use kilwa_measure::Uncertainty;
use kilwa_pack::footer::Footer;
use kilwa_pack::{Index, parse_head};
use question::{Pick, Question};
use remote::{Fetch, Remote, Store};
use std::cell::RefCell;
use std::future::Future;
use std::pin::Pin;
use wasm_bindgen::prelude::{JsCast, JsError, JsValue, wasm_bindgen};
use wasm_bindgen_futures::JsFuture;

/// What has to be fetched beside the head: offset and length of the directory's other pages and of the footer, four numbers.
///
/// # Errors
/// When the head is that of no pack.
#[wasm_bindgen]
pub fn ranges(head: &[u8]) -> Result<Vec<f64>, JsError> {
    let header = parse_head(head)?.header;
    let (pages, footer) = (Index::other_pages(&header), Index::footer_range(&header));
    Ok([pages.0, pages.1, footer.0, footer.1].map(|x| x as f64).to_vec())
}

/// What a pack is called, from its footer.
///
/// # Errors
/// When the bytes are no footer.
#[wasm_bindgen]
pub fn identity(footer: &[u8]) -> Result<String, JsError> {
    Ok(Footer::parse(footer)?.identity())
}

/// One pack.
#[wasm_bindgen]
pub struct Engine {
    index: Index,
    store: RefCell<Store>,
}

/// How JavaScript gives bytes: `fetch(offset, length, fresh)` resolves to them, `tell(done, all)` hears of progress.
struct Callbacks {
    fetch: Function,
    tell: Function,
}

impl Fetch for Callbacks {
    type Sent = Pin<Box<dyn Future<Output = Result<Vec<u8>, String>>>>;

    fn send(&self, offset: u64, length: u64, fresh: bool) -> Self::Sent {
        // Called now, so that it is on its way before anybody waits for it.
        let sent = self.fetch.call3(&JsValue::NULL, &(offset as f64).into(), &(length as f64).into(), &fresh.into());
        Box::pin(async move {
            let promise: Promise = sent.map_err(|e| said(&e))?.dyn_into().map_err(|e| said(&e))?;
            let bytes = JsFuture::from(promise).await.map_err(|e| said(&e))?;
            Ok(Uint8Array::new(&bytes).to_vec())
        })
    }

    fn tell(&self, done: u64, all: u64) {
        // Nobody listens any more: nothing to do about it.
        let _ = self.tell.call2(&JsValue::NULL, &(done as f64).into(), &(all as f64).into());
    }
}

fn said(error: &JsValue) -> String {
    let message = error.dyn_ref::<js_sys::Error>().map(|e| String::from(e.message()));
    message.or_else(|| error.as_string()).unwrap_or_else(|| "the bytes did not come".to_owned())
}

fn sentence(why: &str) -> JsError {
    JsError::new(why)
}

#[wasm_bindgen]
impl Engine {
    /// From the head of a pack and the ranges that [`ranges`] names.
    ///
    /// # Errors
    /// When they do not belong together, or are damaged.
    #[wasm_bindgen(constructor)]
    pub fn new(head: &[u8], pages: &[u8], footer: &[u8]) -> Result<Engine, JsError> {
        Ok(Self { index: Index::parse(head, pages, footer)?, store: RefCell::default() })
    }

    /// What the pack is, as JSON.
    pub fn pack(&self) -> String {
        question::pack(&self.index).to_string()
    }

    /// These chunks hold nothing of the finest surface: the viewer has decoded them. They are not fetched for measuring.
    #[wasm_bindgen(js_name = areLeafless)]
    pub fn are_leafless(&self, chunks: &[u32]) {
        self.store.borrow_mut().are_leafless(chunks.iter().copied());
    }

    /// Bytes of chunks that are kept.
    pub fn held(&self) -> f64 {
        self.store.borrow().held() as f64
    }

    /// A final pick; JSON in and out, `null` where the ray meets nothing.
    ///
    /// # Errors
    /// A sentence.
    pub async fn pick(&self, asked: String, fetch: Function, tell: Function) -> Result<String, JsError> {
        let asked: Pick = serde_json::from_str(&asked)?;
        let leaves = Remote::new(&self.index, &self.store, Callbacks { fetch, tell });
        let mut answer = asked.answer(&leaves).await?;
        if answer.is_object() {
            answer["fetched"] = leaves.fetched().into();
        }
        Ok(answer.to_string())
    }

    /// A measurement; JSON in and out.
    ///
    /// # Errors
    /// A sentence.
    pub async fn measure(&self, asked: String, fetch: Function, tell: Function) -> Result<String, JsError> {
        let asked: Question = serde_json::from_str(&asked)?;
        let leaves = Remote::new(&self.index, &self.store, Callbacks { fetch, tell });
        let mut answer = asked.answer(&leaves).await?;
        answer["fetched"] = leaves.fetched().into();
        Ok(answer.to_string())
    }

    /// A document of measurements, or an answer with lines, as the text of a file of this format.
    ///
    /// # Errors
    /// A sentence.
    pub fn write(&self, what: &str, format: &str, scale: f64) -> Result<String, JsError> {
        question::write(&self.index, &self.point(), what, format, scale).map_err(|e| sentence(&e))
    }

    /// A saved document, as JSON, with `same`.
    ///
    /// # Errors
    /// A sentence.
    pub fn read(&self, text: &str) -> Result<String, JsError> {
        question::read(&self.index, text).map(|v| v.to_string()).map_err(|e| sentence(&e))
    }

    /// A drawing to scale: what stands on it and what each part of its picture looks at; JSON in and out ([`sheet::sheet`]).
    ///
    /// # Errors
    /// A sentence.
    pub fn sheet(&self, asked: &str) -> Result<String, JsError> {
        sheet::sheet(&self.index, asked).map(|v| v.to_string()).map_err(|e| sentence(&e))
    }

    /// Readings as text in a unit, as JSON.
    ///
    /// # Errors
    /// A sentence.
    pub fn shown(&self, readings: &str, unit: &str) -> Result<String, JsError> {
        question::shown(readings, unit).map(|v| v.to_string()).map_err(|e| sentence(&e))
    }

    /// One English sentence that cites a measurement, lengths in this unit.
    ///
    /// # Errors
    /// A sentence of another kind.
    pub fn cite(&self, measurement: &str, unit: &str) -> Result<String, JsError> {
        question::cite(&self.index, measurement, unit).map_err(|e| sentence(&e))
    }
}

impl Engine {
    fn point(&self) -> Uncertainty {
        Uncertainty::finest(self.index.header().lattice.step(), self.index.metadata().capture_accuracy)
    }
}
