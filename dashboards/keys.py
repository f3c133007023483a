"""Keyboard shortcuts, and files handed to the browser's downloads."""

from __future__ import annotations

from collections.abc import Callable

import param
from panel.custom import JSComponent


class Keys(JSComponent):
    """A component of no size that listens for keys and saves files.

    Keys in `typing` work while a text field has the focus; all others are left to the field. Space
    presses a focused button as everywhere.
    """

    combos = param.List(default=[])
    typing = param.List(default=[])
    file_name = param.String(default="")
    file_text = param.String(default="")
    saved = param.Integer(default=0, doc="raised by one for every file to save")

    _esm = """
export function render({model, el}) {
  el.style.display = 'none';
  const key = (e) => (e.ctrlKey || e.metaKey ? 'ctrl+' : '') + (e.altKey ? 'alt+' : '') +
    (e.shiftKey ? 'shift+' : '') + (e.key === ' ' ? 'space' : e.key.toLowerCase());
  const target = (e) => e.composedPath()[0];  // pierces shadow roots
  const isText = (t) => t instanceof HTMLElement && (t.isContentEditable || t.tagName === 'TEXTAREA' ||
    t.tagName === 'SELECT' || (t.tagName === 'INPUT' &&
    !['checkbox', 'radio', 'range', 'button', 'submit', 'file', 'color'].includes(t.type)));
  const isPress = (t) => t instanceof HTMLElement && (t.tagName === 'BUTTON' || t.tagName === 'A' ||
    ['button', 'tab', 'menuitem'].includes(t.getAttribute('role')) || ['checkbox', 'radio'].includes(t.type));
  const onKey = (e) => {
    const k = key(e), t = target(e);
    if (!model.combos.includes(k)) return;
    if (isText(t) && !model.typing.includes(k)) return;
    if (k === 'space' && isPress(t)) return;
    e.preventDefault(); e.stopPropagation();
    if (!e.repeat) model.send_msg(k);
  };
  // The number box of a slider takes a number only with the focus, which Enter ends for it though not for the page;
  // and it writes its number anew at moments of its own, which would end a selection: so the first key typed after the
  // focus or Enter replaces the whole, wherever the cursor came to stand. Left empty, it keeps its number.
  let fresh = null;
  const isBox = (t) => isText(t) && t.getRootNode().querySelector('.MuiSlider-root') !== null;
  const select = (t) => {
    fresh = t;
    let frames = 12;  // in which the number may be written anew
    const step = () => {
      if (fresh !== t || frames-- <= 0) return;
      // Only in the focused box: a selection takes the focus back from where Tab has brought it.
      if (t.getRootNode().activeElement === t && t.selectionStart === t.selectionEnd) t.select();
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  };
  const keep = (t) => {
    if (t.value.trim() !== '') return;
    const now = t.getRootNode().querySelector('input[type=range]').ariaValueNow;
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set.call(t, now);
    t.dispatchEvent(new Event('input', {bubbles: true}));
  };
  const onType = (e) => {
    const t = target(e);
    if (!isBox(t) || ['Shift', 'Control', 'Alt', 'Meta', 'Tab'].includes(e.key)) return;
    if (e.key === 'Enter') keep(t);
    const typed = e.key === 'Delete' || e.key === 'Backspace' || (e.key.length === 1 && !e.ctrlKey && !e.metaKey);
    if (fresh === t && typed && t.selectionStart === t.selectionEnd) t.select();
    fresh = null;
  };
  const onEnter = (e) => {
    const t = target(e);
    if (e.key === 'Enter' && isBox(t)) { t.blur(); t.focus(); select(t); }
  };
  const onTab = (e) => { if (e.key === 'Tab' && isBox(target(e))) select(target(e)); };
  const onPress = (e) => {
    const t = target(e);
    if (isBox(t) && t.getRootNode().activeElement !== t) select(t); else fresh = null;
  };
  const onLeave = (e) => {
    const t = target(e);
    if (isBox(t)) keep(t);
    if (fresh === t) fresh = null;
  };
  const listeners = [['keydown', onKey, true], ['keydown', onType, true], ['keydown', onEnter, false],
    ['keyup', onTab, true], ['pointerdown', onPress, true], ['focusout', onLeave, true]];
  for (const one of listeners) document.addEventListener(...one);
  model.on('saved', () => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(new Blob([model.file_text], {type: 'text/plain;charset=utf-8'}));
    link.download = model.file_name; link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  });
  model.on('remove', () => { for (const one of listeners) document.removeEventListener(...one); });
}
"""

    def __init__(self, actions: dict[str, Callable[[], None]], typing=(), **params):
        self._actions = dict(actions)
        super().__init__(
            combos=list(self._actions), typing=list(typing), width=0, height=0, margin=0, **params
        )

    def _handle_msg(self, msg):
        if msg in self._actions:
            self._actions[msg]()

    def save(self, name: str, text: str) -> None:
        """Hands a text file to the browser's downloads."""
        self.param.update(file_name=name, file_text=text)
        self.saved += 1


class Copy(JSComponent):
    """A small button that copies its text, also where the page is not on localhost."""

    text = param.String(default="")
    label = param.String(default="Copy")

    _esm = """
export function render({model}) {
  const button = document.createElement('button');
  const show = () => { button.textContent = model.label; button.title = 'Copy ' + model.text;
                       button.setAttribute('aria-label', 'Copy ' + model.text); };
  button.style.cssText = 'font: inherit; font-size: 12px; padding: 1px 6px; cursor: pointer; border-radius: 4px;' +
    'border: 1px solid currentColor; background: transparent; color: inherit; opacity: 0.8';
  const old_way = (s) => { const t = document.createElement('textarea'); t.value = s;
    t.style.position = 'fixed'; t.style.opacity = 0; document.body.appendChild(t); t.select();
    const ok = document.execCommand('copy'); t.remove(); return ok; };
  button.onclick = async () => {
    let ok = true;
    try { await navigator.clipboard.writeText(model.text); } catch (e) { ok = old_way(model.text); }
    button.textContent = ok ? 'Copied' : 'Not copied'; setTimeout(show, 1200);
  };
  model.on('text', show); show();
  return button;
}
"""
