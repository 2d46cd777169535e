// SPDX-License-Identifier: GPL-3.0-or-later

// The page of `handover panel`: draws the values that page.py gives it, and sends orders back. All that comes from
// outside is set as text, never as HTML.
//
// Slips are guarded against. A button that has just appeared takes no press for FRESH ms. Accept and Deny by key need
// the key held for HOLD ms. Give, Release, Return and Override need a second press.
"use strict";
window.handoverPanel = (() => {
  const HOLD = 600, FRESH = 700, SURE = 4000, READ = 2000, SILENT = 2500, REPLY = 8000;
  const KEYS = { a: "accept", d: "deny" };
  const TWICE = ["release", "return", "start", "sign_off"];
  const state = { part: {}, at: performance.now(), cut: false, band: null, open: "", openAt: 0, born: {}, reply: null,
    attached: false, asked: false, field: null, shift: "", shiftAt: 0, sound: "", muted: false, audio: null, rung: 0, hold: null, rows: {} };

  function made(tag, name, words) {
    const element = document.createElement(tag);
    if (name) element.className = name;
    if (words !== undefined) element.textContent = words;
    return element;
  }

  function fill(part, children) {
    const element = document.querySelector(".hp-" + part);
    if (element) element.replaceChildren(...children.filter(Boolean));
    return element;
  }

  function titled(title, inside, empty) {
    return [made("div", "hp-title", title), ...(inside.length ? inside : [made("div", "hp-none", empty)])];
  }

  // The key for orders comes once, behind the # of the address. The storage belongs to this port alone. Without storage
  // (a browser may block it) the key lasts as long as this page.
  let orderKey = "";
  function keyOfLink() {
    const given = location.hash.slice(1);
    if (given) {
      orderKey = given;
      history.replaceState(null, "", location.pathname + location.search);
    }
    try {
      if (given) localStorage.setItem("handover_panel", given);
      orderKey = localStorage.getItem("handover_panel") || orderKey;
    } catch (error) {
      console.error(error);
    }
    return orderKey;
  }

  // ---- orders -----------------------------------------------------------------------------------------------------

  function send(vehicle, button, argument) {
    state.open = "";
    document.querySelectorAll(".hp-main button").forEach((each) => { // a double click is one order
      state.born[each.dataset.key] = performance.now();
      each.disabled = true;
    });
    emitEvent("panel_order", { key: keyOfLink(), do: button.do, vehicle, argument: argument === undefined ? button.argument : argument });
    reply({ used: true, text: button.label + " sent." });
  }

  function reply(given) {
    state.reply = { ...given, at: performance.now() };
    draw();
  }

  function key(vehicle, button) {
    return [vehicle, button.do, button.argument].join(" ");
  }

  function fresh(name) {
    return performance.now() - (state.born[name] || 0) < FRESH;
  }

  function press(vehicle, button) {
    if (button.do === "sign_on") { askName(); return; }
    const name = key(vehicle, button);
    if (state.cut || fresh(name)) return;
    const twice = TWICE.includes(button.do), choices = button.choices.length > 0;
    if ((twice || choices) && state.open !== name) {
      state.open = name;
      state.openAt = performance.now();
      draw();
    } else if (!choices) {
      send(vehicle, button);
    } else {
      state.open = "";
      draw();
    }
  }

  function button(vehicle, given, held) {
    const name = key(vehicle, given), open = state.open === name;
    const element = made("button", given.do, given.label);
    element.type = "button";
    element.dataset.key = name;
    if (TWICE.includes(given.do) && open) {
      element.textContent = given.label + ": press again";
      element.classList.add("sure");
    }
    if (held) {
      const letter = Object.keys(KEYS).find((each) => KEYS[each] === given.do);
      if (letter) element.append(made("kbd", "", "hold " + letter.toUpperCase()), made("span", "held"));
      if (state.hold && state.hold.name === name) element.classList.add("holding");
    }
    element.disabled = fresh(name);
    element.addEventListener("click", (event) => {
      event.stopPropagation();
      // a key on a button that has the focus is no answer: answers by key are held
      if (event.detail === 0 && Object.values(KEYS).includes(given.do)) return;
      press(vehicle, given);
    });
    if (!open || !given.choices.length) return element;
    const group = made("span", "hp-choices");
    element.classList.add("sure");
    group.append(element, ...given.choices.map((choice) => {
      const each = made("button", "", choice);
      each.type = "button";
      each.addEventListener("click", () => send(vehicle, given, choice));
      return each;
    }));
    return group;
  }

  function note(vehicle, buttons) {
    const now = performance.now();
    buttons.forEach((each) => { const name = key(vehicle, each); seen.add(name); state.born[name] ||= now; });
  }

  let seen = new Set();

  function hold(event) {
    const wanted = KEYS[event.key.toLowerCase()];
    const typing = ["INPUT", "TEXTAREA", "SELECT"].includes((event.target.tagName || "").toUpperCase());
    if (!wanted || event.repeat || event.ctrlKey || event.altKey || event.metaKey || typing || state.cut) return;
    const band = state.band, found = band && band.main.find((each) => each.do === wanted);
    if (!found || fresh(key(band.vehicle, found))) return;
    const name = key(band.vehicle, found), vehicle = band.vehicle;
    release();
    state.hold = { letter: event.key.toLowerCase(), name };
    state.hold.timer = setTimeout(() => {
      const still = state.band && state.band.main.some((each) => key(state.band.vehicle, each) === name);
      release();
      if (still && !state.cut) send(vehicle, found);
    }, HOLD);
    const shown = document.querySelector(`.hp-band button[data-key="${CSS.escape(name)}"]`);
    if (shown) requestAnimationFrame(() => shown.classList.add("holding"));
  }

  function release(event) {
    if (!state.hold || (event && event.key && event.key.toLowerCase() !== state.hold.letter)) return;
    clearTimeout(state.hold.timer);
    state.hold = null;
    document.querySelectorAll(".hp-band .holding").forEach((each) => each.classList.remove("holding"));
  }

  // ---- the band ---------------------------------------------------------------------------------------------------

  const CUT = {
    vehicle: 0, name: "", aircraft: "", level: "emergency", who: "unknown", words: "NOT KNOWN", colour: "", pinned: false,
    next: "This page gets nothing from the panel's program any more.",
    do: "Start it again: handover panel, and open its new link.", main: [], more: [],
  };

  function counted(words) {
    return words.split(/(in \d+ s|\bnow\b)/).map((part, index) => (index % 2 ? made("b", "", part) : part));
  }

  // Buttons are made anew only if they change: a press must find the button that it began on.
  function buttons(place, vehicle, given, held) {
    const sign = JSON.stringify([vehicle, given, given.map((each) => state.open === key(vehicle, each))]);
    if (place.dataset.sign === sign) return;
    place.dataset.sign = sign;
    place.replaceChildren(...given.map((each) => button(vehicle, each, held)));
  }

  function skeleton() {
    const found = document.querySelector(".hp-band");
    if (found.childElementCount) return found;
    const who = made("div", "hp-who"), todo = made("div", "hp-do main"), more = made("div", "hp-more");
    who.append(made("small"), made("strong"), made("em"));
    todo.append(made("span"), made("div", "hp-main"));
    const answer = made("span", "hp-reply");
    answer.hidden = true;
    more.append(answer, made("span", "hp-choices"));
    found.append(who, made("div", "hp-next"), todo, more);
    return found;
  }

  function drawBand() {
    const band = state.cut ? CUT : state.part.band;
    if (!band) return;
    if (state.hold && !band.main.some((each) => key(band.vehicle, each) === state.hold.name)) release();
    state.band = band;
    const [who, next, todo, more] = skeleton().children;
    skeleton().className = "hp-band " + band.level;
    who.className = "hp-who" + (band.words.length > 14 ? " long" : "");
    who.firstChild.textContent = [band.aircraft, "in command", band.operator].filter(Boolean).join(" · ");
    const dot = band.colour ? made("i") : "";
    if (dot) dot.style.background = band.colour;
    who.children[1].replaceChildren(dot, band.words);
    who.lastChild.textContent = band.note || "";
    next.replaceChildren(...counted(band.next));
    todo.firstChild.textContent = band.do;
    buttons(todo.lastChild, band.vehicle, band.main, true);
    buttons(more.lastChild, band.vehicle, band.more, false);
    more.firstChild.hidden = !state.reply;
    more.firstChild.textContent = state.reply ? state.reply.text : "";
    more.firstChild.className = "hp-reply" + (state.reply && !state.reply.used ? " unused" : "");
  }

  function drawRow(row) {
    let element = state.rows[row.vehicle];
    if (!element) {
      element = state.rows[row.vehicle] = made("div");
      element.append(made("b"), made("span"), made("span", "next"), made("span", "do"), made("span", "buttons"));
      element.title = "show this aircraft; press again to show the most urgent one";
      element.addEventListener("click", () => emitEvent("panel_pin", { vehicle: row.vehicle }));
    }
    element.className = "hp-row " + row.level + (row.vehicle === state.part.band.vehicle ? " chosen" : "");
    const words = [row.name, row.words, row.next, row.do];
    words.forEach((each, index) => { element.children[index].textContent = each; });
    const shown = row.vehicle !== state.part.band.vehicle && !row.dead && !state.cut;
    buttons(element.lastChild, row.vehicle, shown ? row.main : [], false);
    return element;
  }

  function drawRows() {
    const place = document.querySelector(".hp-rows");
    const wanted = state.part.band ? (state.part.rows || []).map(drawRow) : [];
    const same = wanted.length === place.childElementCount && wanted.every((each, index) => place.children[index] === each);
    if (!same) place.replaceChildren(...wanted);
  }

  // ---- the operator on duty ---------------------------------------------------------------------------------------

  function plain(words, name, run) {
    const element = made("button", name, words);
    element.type = "button";
    element.addEventListener("click", run);
    return element;
  }

  function order(what, argument, label) {
    if (!state.cut) send(0, { do: what, argument, label });
  }

  // The field is made once: what is typed in it must not go when the values change.
  function nameField() {
    if (!state.field) {
      const field = (state.field = made("form", "hp-name")), input = made("input");
      Object.assign(input, { type: "text", maxLength: 30, placeholder: "your name", autocomplete: "off", spellcheck: false });
      input.setAttribute("aria-label", "your name");
      const done = made("button", "", "Sign on");
      done.type = "submit";
      field.append(input, done, plain("Cancel", "cancel", () => { state.asked = false; drawDuty(); }));
      field.addEventListener("submit", (event) => {
        event.preventDefault();
        const name = input.value.trim();
        if (!name) { input.focus(); return; }
        order("sign_on", name, "Sign-on");
        state.asked = false;
        input.value = "";
        drawDuty();
      });
    }
    return state.field;
  }

  function askName() {
    state.asked = true;
    drawDuty();
    nameField().firstChild.focus();
  }

  function drawDuty() {
    const duty = state.part.duty;
    if (!duty) return;
    const name = duty.operator ? [made("span", "", "operator "), made("b", "", duty.operator)]
      : [made("span", duty.required ? "silent" : "", "no operator on duty")];
    const able = duty.can && !state.cut;
    const off = { do: "sign_off", label: "Sign off", argument: "", choices: [] };
    const buttons = !able ? [] : state.asked ? [nameField()]
      : duty.operator ? [plain("Change shift", "", askName), button(0, off, false)] : [plain("Sign on", "", askName)];
    state.born[key(0, off)] ||= 1;
    fill("duty", [...(able ? name : []), ...buttons]);
  }

  // ---- the parts below --------------------------------------------------------------------------------------------

  function table(rows) {
    const element = made("div", "hp-table");
    element.append(...rows.flat());
    return [element];
  }

  const DRAW = {
    head: (given) => {
      const sound = made("button", "", soundWords());
      sound.type = "button";
      sound.addEventListener("click", toggle);
      const name = made("span", "", "this station: ");
      name.append(made("b", "", given.station || "none"));
      fill("head", [name, made("span", "program", given.program), sound]);
      document.title = (given.station || "handover") + " panel";
    },
    duty: () => drawDuty(),
    shift: (given) => {
      if (!given.next) { state.shift = ""; fill("shift", []); return; }
      if (state.shift !== given.next) { // its buttons are made once: a press must find the button that it began on
        state.shift = given.next;
        state.shiftAt = performance.now();
        const take = plain(`${given.next}: I take over`, "confirm", () => order("confirm", given.next, "Confirmation"));
        take.disabled = true;
        const cancel = plain("Cancel", "cancel", () => order("sign_on", given.operator, "Cancel"));
        fill("shift", [made("div", "hp-title"), made("div"), take, cancel]);
      }
      const [title, rows] = document.querySelector(".hp-shift").children;
      title.textContent = `shift change: ${given.operator} to ${given.next} · read, then confirm · ${given.left}`;
      rows.replaceChildren(...given.rows.map(([name, words]) => {
        const row = made("p");
        row.append(made("b", "", name + ": "), words);
        return row;
      }));
    },
    alarms: (given) => fill("alarms", titled("alarms", given.map((alarm) => {
      const element = made("div", `hp-alarm ${alarm.level} ${alarm.state}${alarm.acknowledged ? " done" : ""}`);
      const words = alarm.acknowledged ? "acknowledged, " + alarm.since : alarm.since;
      if (alarm.aircraft) element.append(made("b", "", alarm.aircraft + ": "));
      element.append(made("b", "", alarm.text), " ", made("span", "hp-age", words));
      if (alarm.cause) element.append(made("p", "", alarm.cause));
      if (alarm.remedy) element.append(made("p", "", "→ " + alarm.remedy));
      return element;
    }), state.part.head.dead ? "not known" : "no alarm stands")),
    briefing: (given) => fill("briefing", given.rows.length ? [
      made("div", "hp-title", "briefing"), made("span", "hp-age", given.age),
      ...table(given.rows.map(([label, text]) => [made("span", "label", label), made("span", "", text), made("span")])),
    ] : []),
    values: (given) => fill("values", titled("aircraft", table(given.map((each) => [
      made("span", "label", each.label), made("span", "value " + each.state, each.state === "gone" ? "not known" : each.text),
      made("span", "hp-age", each.age),
    ])), "nothing heard yet")),
    links: (given) => fill("links", titled("links to the aircraft", table(given.map((link) => [
      made("span", link.works ? "" : "silent", link.works ? "●" : "○"),
      made("span", link.works ? "" : "silent", link.name + (link.used ? "" : " (spare)") + (link.works ? "" : ": " + link.text)),
      made("span", "hp-age", link.age),
    ])), "no link")),
    peers: (given) => fill("peers", titled("other stations", table(given.map((peer) => {
      const chip = made("span", "hp-chip", peer.name);
      chip.style.background = peer.colour;
      const words = [peer.text, peer.operator, peer.commands ? "commands " + peer.commands : ""].filter(Boolean);
      return [chip, made("span", peer.up ? "" : "silent", words.join(", ")), made("span", "hp-age", peer.age)];
    })), "none is configured")),
    lines: (given) => fill("lines", titled("events", given.map((line) => {
      const element = made("div", "hp-line " + line.level);
      element.append(made("span", "hp-age", line.age + " ago "), line.aircraft ? made("b", "", line.aircraft + " ") : "", line.text);
      return element;
    }), "none yet")),
  };

  function draw() {
    drawBand();
    drawRows();
    if (state.dutySign !== (state.dutySign = [state.cut, state.open].join())) drawDuty();
  }

  function show(given) {
    state.at = performance.now();
    state.cut = false;
    (given.replies || []).forEach((each) => { state.reply = { ...each, at: state.at }; });
    if ("sound" in given) state.sound = given.sound;
    Object.assign(state.part, given);
    if (given.head && state.part.alarms) given.alarms = state.part.alarms;
    if (given.band || given.rows) {
      seen = new Set();
      [state.part.band, ...(state.part.rows || [])].forEach((each) => note(each.vehicle, [...each.main, ...each.more]));
      Object.keys(state.born).filter((name) => !seen.has(name) && !name.startsWith("0 ")).forEach((name) => delete state.born[name]);
      if (!seen.has(state.open) && !state.open.startsWith("0 ")) state.open = "";
    }
    Object.keys(DRAW).filter((name) => name in given).forEach((name) => DRAW[name](given[name]));
    draw();
  }

  // ---- sound ------------------------------------------------------------------------------------------------------

  function soundWords() {
    if (!state.audio || state.audio.state !== "running") return "Sound is off: press to allow it";
    return state.muted ? "Sound is off: press for sound" : "Sound is on";
  }

  function toggle() {
    if (!state.audio) state.audio = new AudioContext();
    if (state.audio.state === "running") state.muted = !state.muted;
    state.audio.resume().then(() => DRAW.head(state.part.head));
  }

  function ring() {
    const every = { emergency: 2500, warning: 10000 }[state.cut ? "emergency" : state.sound];
    const now = performance.now();
    if (!every) { state.rung = 0; return; }
    if (now - state.rung < every || state.muted || !state.audio || state.audio.state !== "running") return;
    state.rung = now;
    const tones = every < 5000 ? [880, 660, 880, 660] : [660, 880];
    tones.forEach((pitch, index) => {
      const tone = state.audio.createOscillator(), loud = state.audio.createGain();
      const at = state.audio.currentTime + index * 0.18;
      tone.frequency.value = pitch;
      loud.gain.value = 0.15;
      tone.connect(loud).connect(state.audio.destination);
      tone.start(at);
      tone.stop(at + 0.15);
    });
  }

  // ---- time -------------------------------------------------------------------------------------------------------

  function tick() {
    if (!document.querySelector(".hp-band")) return; // the page is being built
    const now = performance.now();
    if (!state.cut && now - state.at > SILENT) { state.cut = true; release(); draw(); }
    if (state.open && now - state.openAt > SURE) { state.open = ""; draw(); }
    if (state.reply && now - state.reply.at > REPLY) { state.reply = null; draw(); }
    const take = document.querySelector(".hp-shift button.confirm");
    if (take) take.disabled = state.cut || now - state.shiftAt < READ;
    document.querySelectorAll(".hp-band button:disabled, .hp-rows button:disabled, .hp-duty button:disabled").forEach((each) => {
      if (!fresh(each.dataset.key)) each.disabled = false;
    });
    ring();
  }

  // It begins with the document: a page whose connection never comes must say so, and not stay empty.
  function attach() {
    if (state.attached) return;
    state.attached = true;
    keyOfLink();
    document.addEventListener("keydown", hold);
    document.addEventListener("keyup", release);
    window.addEventListener("blur", () => release());
    setInterval(tick, 200);
  }

  document.addEventListener("DOMContentLoaded", attach);
  return { attach, show };
})();
