//! Measuring as a wasm module for a Web Worker: questions in, final values out, the same to the last digit as `kilwa measure` prints.
//!
//! JavaScript gives the bytes (`www/measure/engine.js` through the page's loader) and carries JSON; everything that is computed is
//! `kilwa_measure`'s. Several questions may be open at a time; each is cancelled by rejecting what it waits for. What is thrown is an `Error` whose
//! message is English and whose `said` is the same as JSON for the page's language ([`kilwa_measure::message`]).

pub mod question;
pub mod remote;
pub mod sheet;

use js_sys::{Function, Promise, Uint8Array};
use kilwa_measure::{Failure, ToMessage, Uncertainty};
use kilwa_pack::{Index, PackError};
use question::{Pick, Question, QuestionError};
use remote::{Fetch, Remote, Store};
use sheet::SheetHost;
use std::cell::RefCell;
use std::future::Future;
use std::pin::Pin;
use wasm_bindgen::prelude::{JsCast, JsValue, wasm_bindgen};
use wasm_bindgen_futures::JsFuture;

/// One pack.
#[wasm_bindgen]
pub struct Engine {
    index: Index,
    store: RefCell<Store>,
}

/// How JavaScript gives bytes: `fetch(offset, length, fresh)` resolves to them, `on_progress(done, all)` is called with the progress.
struct Callbacks {
    fetch: Function,
    on_progress: Function,
}

impl Fetch for Callbacks {
    type Sent = Pin<Box<dyn Future<Output = Result<Vec<u8>, String>>>>;

    fn send(&self, offset: u64, length: u64, fresh: bool) -> Self::Sent {
        // Called now, so that it is on its way before anybody waits for it.
        let sent = self.fetch.call3(&JsValue::NULL, &(offset as f64).into(), &(length as f64).into(), &fresh.into());
        Box::pin(async move {
            let promise: Promise = sent.map_err(|e| text_of(&e))?.dyn_into().map_err(|e| text_of(&e))?;
            let bytes = JsFuture::from(promise).await.map_err(|e| text_of(&e))?;
            Ok(Uint8Array::new(&bytes).to_vec())
        })
    }

    fn report_progress(&self, done: u64, all: u64) {
        // Nobody listens any more: nothing to do about it.
        let _ = self.on_progress.call2(&JsValue::NULL, &(done as f64).into(), &(all as f64).into());
    }
}

fn text_of(error: &JsValue) -> String {
    let message = error.dyn_ref::<js_sys::Error>().map(|e| String::from(e.message()));
    message.or_else(|| error.as_string()).unwrap_or_else(|| "the bytes did not come".to_owned())
}

/// What is thrown.
fn thrown(why: &impl ToMessage) -> JsValue {
    let error = js_sys::Error::new(&why.to_string());
    // A new object takes any property.
    let _ = js_sys::Reflect::set(&error, &"said".into(), &why.as_json().to_string().into());
    error.into()
}

/// What a damaged pack is thrown as.
fn damaged(why: PackError) -> JsValue {
    thrown(&Failure::Pack(why))
}

/// A question that is none.
fn asked(why: serde_json::Error) -> JsValue {
    thrown(&QuestionError::Asked(why))
}

#[wasm_bindgen]
impl Engine {
    /// From the head of a pack, its directory's pages from the second on, and its footer.
    ///
    /// # Errors
    /// When they do not belong together, or are damaged.
    #[wasm_bindgen(constructor)]
    pub fn new(head: &[u8], pages: &[u8], footer: &[u8]) -> Result<Engine, JsValue> {
        Ok(Self { index: Index::parse(head, pages, footer).map_err(damaged)?, store: RefCell::default() })
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
    pub async fn pick(&self, asked: String, fetch: Function, on_progress: Function) -> Result<String, JsValue> {
        let asked: Pick = serde_json::from_str(&asked).map_err(self::asked)?;
        let leaves = Remote::new(&self.index, &self.store, Callbacks { fetch, on_progress });
        let mut answer = asked.answer(&leaves).await.map_err(|e| thrown(&e))?;
        if answer.is_object() {
            answer["fetched"] = leaves.fetched().into();
        }
        Ok(answer.to_string())
    }

    /// A measurement; JSON in and out.
    ///
    /// # Errors
    /// A sentence.
    pub async fn measure(&self, asked: String, fetch: Function, on_progress: Function) -> Result<String, JsValue> {
        let asked: Question = serde_json::from_str(&asked).map_err(self::asked)?;
        let leaves = Remote::new(&self.index, &self.store, Callbacks { fetch, on_progress });
        let mut answer = asked.answer(&leaves).await.map_err(|e| thrown(&e))?;
        answer["fetched"] = leaves.fetched().into();
        Ok(answer.to_string())
    }

    /// A document of measurements, or an answer with lines, as the text of a file of this format.
    ///
    /// # Errors
    /// A sentence.
    pub fn write(&self, what: &str, format: &str, scale: f64) -> Result<String, JsValue> {
        question::write(&self.index, &self.point(), what, format, scale).map_err(|e| thrown(&e))
    }

    /// A saved document, as JSON, with `same`.
    ///
    /// # Errors
    /// A sentence.
    pub fn read(&self, text: &str) -> Result<String, JsValue> {
        question::read(&self.index, text).map(|v| v.to_string()).map_err(|e| thrown(&e))
    }

    /// Make a drawing to scale: JSON in and out ([`sheet`]). `host` renders, paints and writes.
    ///
    /// # Errors
    /// A message, or the exception that `host` threw.
    #[wasm_bindgen(js_name = drawSheet)]
    pub async fn draw_sheet(&self, asked: String, host: SheetHost) -> Result<String, JsValue> {
        sheet::draw(&self.index, &asked, host).await.map_err(|e| e.0)
    }

    /// Readings as text in a unit, as JSON.
    ///
    /// # Errors
    /// A sentence.
    pub fn shown(&self, readings: &str, unit: &str) -> Result<String, JsValue> {
        question::shown(readings, unit).map(|v| v.to_string()).map_err(|e| thrown(&e))
    }

    /// One English sentence that cites a measurement, lengths in this unit.
    ///
    /// # Errors
    /// A sentence of another kind.
    pub fn cite(&self, measurement: &str, unit: &str) -> Result<String, JsValue> {
        question::cite(&self.index, measurement, unit).map_err(|e| thrown(&e))
    }
}

impl Engine {
    fn point(&self) -> Uncertainty {
        Uncertainty::of_pack(&self.index)
    }
}
