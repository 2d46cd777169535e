// SPDX-License-Identifier: GPL-3.0-or-later

// The map of `handover watch` and `handover panel`: draws what page.py gives it each second. It asks for nothing and
// sends nothing; all that came from outside is set as text, never as HTML.
"use strict";
window.handoverWatch = (() => {
  const STEPS = [1, 2, 5];
  const TRACK = 4000; // as scene.TRACK
  const state = { map: null, waiting: [], missions: {}, craft: {}, returns: {}, borders: {}, fitted: false, moved: false };

  function text(words, name) {
    const made = document.createElement("div");
    made.className = name;
    made.textContent = words;
    return made;
  }

  function icon(inside, name, size) {
    return L.divIcon({ html: inside, className: name, iconSize: size, iconAnchor: [size[0] / 2, size[1] / 2] });
  }

  // ---- grid, scale, north -----------------------------------------------------------------------------------------

  function step(span) {
    const power = Math.pow(10, Math.floor(Math.log10(span)));
    return STEPS.map((each) => each * power).filter((each) => each <= span).pop() || power;
  }

  function degrees(value, digits, letters) {
    const wrapped = ((((value + 180) % 360) + 360) % 360) - 180;
    const shown = letters === "NS" ? value : wrapped;
    return Math.abs(shown).toFixed(digits) + "° " + letters[shown < 0 ? 1 : 0];
  }

  function grid(map, layer) {
    layer.clearLayers();
    const bounds = map.getBounds(), size = map.getSize();
    const wide = bounds.getEast() - bounds.getWest(), high = bounds.getNorth() - bounds.getSouth();
    if (!(wide > 0) || !(high > 0) || wide > 360) return;
    const style = { color: "#808080", opacity: 0.28, weight: 1, interactive: false };
    const each = (span, pixels, low, top, draw) => {
      const by = step((span * 130) / pixels);
      const digits = Math.max(0, -Math.floor(Math.log10(by) + 1e-6));
      for (let n = Math.ceil(low / by); n * by <= top; n++) draw(n * by, digits);
    };
    const label = (at, words, name) =>
      layer.addLayer(L.marker(at, { icon: icon(text(words, ""), "hw-degrees " + name, [90, 14]), interactive: false }));
    each(wide, size.x, bounds.getWest(), bounds.getEast(), (lon, digits) => {
      layer.addLayer(L.polyline([[bounds.getSouth(), lon], [bounds.getNorth(), lon]], style));
      const top = map.containerPointToLatLng([0, 8]);
      label([top.lat, lon], degrees(lon, digits, "EW"), "hw-meridian");
    });
    each(high, size.y, bounds.getSouth(), bounds.getNorth(), (lat, digits) => {
      layer.addLayer(L.polyline([[lat, bounds.getWest()], [lat, bounds.getEast()]], style));
      const right = map.containerPointToLatLng([size.x - 48, 0]);
      label([lat, right.lng], degrees(lat, digits, "NS"), "hw-parallel");
    });
  }

  function corner(position, make) {
    const Made = L.Control.extend({ options: { position }, onAdd: make });
    state.map.addControl(new Made());
  }

  function attach(element, tiles) {
    const found = getElement(element);
    if (!window.L || !found || !found.map) {
      setTimeout(() => attach(element, tiles), 100);
      return;
    }
    const map = (state.map = found.map);
    map.createPane("zones").style.zIndex = 390;
    if (tiles) {
      const options = { attribution: tiles.credit, maxZoom: 20 };
      if ("low" in tiles) Object.assign(options, { minNativeZoom: tiles.low, maxNativeZoom: tiles.high });
      if (tiles.bounds) options.bounds = tiles.bounds;
      L.tileLayer(tiles.url, options).addTo(map);
    }
    state.grid = L.layerGroup().addTo(map);
    L.control.scale({ imperial: false }).addTo(map);
    corner("topright", () => text("▲\nN", "hw-north"));
    corner("topleft", () => {
      const made = text("⤢", "hw-fit");
      made.title = "show all";
      L.DomEvent.disableClickPropagation(made);
      made.onclick = () => { state.moved = false; fit(); };
      return made;
    });
    map.on("dragstart", () => { state.moved = true; });
    map.getContainer().addEventListener("wheel", () => { state.moved = true; }, { passive: true });
    map.on("moveend resize", () => grid(map, state.grid));
    new ResizeObserver(() => { map.invalidateSize({ animate: false }); if (!state.moved) fit(); }).observe(map.getContainer());
    grid(map, state.grid);
    state.waiting.splice(0).forEach(show);
  }

  // ---- missions ---------------------------------------------------------------------------------------------------

  function mission(given) {
    if (state.missions[given.key]) return;
    const map = state.map, zones = [], pane = "zones";
    given.zones.forEach((zone) => {
      const area = L.polygon(zone.rings, {
        pane, color: zone.colour, weight: 2, fillOpacity: 0.07, interactive: false, fillRule: "evenodd",
      }).addTo(map);
      const name = text(zone.words.join("\n"), "hw-zone");
      name.style.color = zone.colour;
      L.marker(zone.at, { icon: icon(name, "hw-label", [140, 30]), interactive: false }).addTo(map);
      zones.push({ station: zone.station, area, name });
    });
    L.polyline(given.overlaps, { pane, color: "#969696", weight: 1, opacity: 0.6, interactive: false }).addTo(map);
    given.route.forEach((path) => {
      L.polyline(path.lines, {
        pane, color: path.colour, weight: 2, opacity: 0.75, dashArray: "2 6", interactive: false,
      }).addTo(map);
    });
    given.crossings.forEach((each) => {
      const made = text(String(each.number), "hw-crossing");
      made.style.borderColor = each.colour;
      L.marker(each.at, { icon: icon(made, "hw-label", [18, 18]), interactive: false }).addTo(map);
    });
    L.marker(given.home, { icon: icon(text("H", "hw-home"), "hw-label", [18, 18]), interactive: false }).addTo(map);
    given.rally.forEach((at) =>
      L.marker(at, { icon: icon(text("R", "hw-home"), "hw-label", [18, 18]), interactive: false }).addTo(map));
    state.missions[given.key] = { zones };
    state.fitted = false;
  }

  function broad(commanding) {
    Object.entries(state.missions).forEach(([key, known]) => {
      const names = commanding[key] || [];
      known.zones.forEach((zone) => {
        const commands = names.includes(zone.station);
        if (zone.commands === commands) return;
        zone.commands = commands;
        zone.area.setStyle({ weight: commands ? 4 : 2, fillOpacity: commands ? 0.14 : 0.07 });
        zone.name.classList.toggle("hw-commands", commands);
      });
    });
  }

  // ---- aircraft ---------------------------------------------------------------------------------------------------

  function craft(name) {
    if (!state.craft[name]) {
      const arrow = document.createElement("div");
      arrow.className = "hw-craft";
      const label = text(name, "hw-name");
      const inside = document.createElement("div");
      inside.append(arrow, label);
      state.craft[name] = { arrow, label, inside, marker: null, pieces: [], count: 0 };
    }
    return state.craft[name];
  }

  function track(given) {
    const known = craft(given.name);
    given.points.forEach(([lat, lon, colour]) => {
      const last = known.pieces[known.pieces.length - 1];
      const at = [lat, lon];
      if (last && last.colour === colour) {
        last.line.addLatLng(at);
        last.count++;
      } else {
        const begin = last ? [last.end, at] : [at];
        const line = L.polyline(begin, { color: colour, weight: 3, interactive: false }).addTo(state.map);
        known.pieces.push({ colour, line, count: 1 });
      }
      known.pieces[known.pieces.length - 1].end = at;
      known.count++;
    });
    while (known.count > 2 * TRACK && known.pieces.length > 1) {
      const first = known.pieces.shift();
      known.count -= first.count;
      first.line.remove();
    }
    const first = known.pieces[0];
    if (first && first.count > 2 * TRACK) {
      first.line.setLatLngs(first.line.getLatLngs().slice(-TRACK));
      known.count -= first.count - TRACK;
      first.count = TRACK;
    }
  }

  function mark(given) {
    const known = craft(given.name);
    if (!known.marker) {
      const made = icon(known.inside, "hw-label", [26, 26]);
      known.marker = L.marker(given.at, { icon: made, interactive: false, zIndexOffset: 1000 }).addTo(state.map);
    }
    known.marker.setLatLng(given.at);
    let heading = given.heading;
    if (heading === null && known.at && (known.at[0] !== given.at[0] || known.at[1] !== given.at[1])) {
      const east = (given.at[1] - known.at[1]) * Math.cos((given.at[0] * Math.PI) / 180);
      heading = (Math.atan2(east, given.at[0] - known.at[0]) * 180) / Math.PI;
    }
    if (heading !== null) known.heading = heading;
    known.at = given.at;
    known.arrow.style.setProperty("--turn", (known.heading || 0) + "deg");
    known.arrow.style.setProperty("--colour", given.colour);
    known.arrow.dataset.level = given.level;
    known.inside.classList.toggle("hw-old", given.old !== "");
    known.label.textContent = given.old ? given.label + " · " + given.old : given.label;
  }

  // a line from an aircraft to the place that a return goes to
  function returns(given) {
    const there = new Set(given.map((each) => each.key));
    Object.keys(state.returns).filter((key) => !there.has(key)).forEach((key) => {
      state.returns[key].forEach((each) => each.remove());
      delete state.returns[key];
    });
    given.forEach((each) => {
      if (!state.returns[each.key]) {
        const line = L.polyline(each.lines, { weight: 2, dashArray: "7 5", interactive: false }).addTo(state.map);
        const made = icon(text(each.words, "hw-return"), "hw-label", [0, 0]);
        const sign = L.marker(each.lines[1], { icon: made, interactive: false }).addTo(state.map);
        state.returns[each.key] = [line, sign];
      }
      const [line, sign] = state.returns[each.key];
      line.setLatLngs(each.lines);
      line.setStyle({ color: each.strong ? "#c80000" : "#0a7a34", weight: each.strong ? 4 : 2 });
      sign.setLatLng(each.lines[1]);
      sign.getElement().firstChild.textContent = "⌂ " + each.words;
    });
  }

  // the border at which each aircraft changes its commander next
  function borders(given) {
    const there = new Set(given.map((each) => each.key));
    Object.keys(state.borders).filter((key) => !there.has(key)).forEach((key) => {
      state.borders[key].remove();
      delete state.borders[key];
    });
    given.forEach((each) => {
      if (!state.borders[each.key]) {
        const made = icon(text(each.words, "hw-next"), "hw-label", [0, 0]);
        state.borders[each.key] = L.marker(each.at, { icon: made, interactive: false, zIndexOffset: 900 }).addTo(state.map);
      }
      state.borders[each.key].setLatLng(each.at);
      state.borders[each.key].getElement().firstChild.textContent = each.words;
    });
  }

  function fit() {
    const bounds = L.latLngBounds([]);
    Object.values(state.missions).forEach((each) => each.zones.forEach((zone) => bounds.extend(zone.area.getBounds())));
    Object.values(state.craft).forEach((each) => { if (each.at) bounds.extend(each.at); });
    if (!bounds.isValid()) return false;
    state.map.fitBounds(bounds, { padding: [24, 24], maxZoom: 17, animate: false });
    return true;
  }

  function show(given) {
    if (!state.map) {
      state.waiting.push(given);
      return;
    }
    given.missions.forEach(mission);
    borders(given.borders || []);
    given.tracks.forEach(track);
    given.marks.forEach(mark);
    returns(given.returns || []);
    const there = new Set(given.marks.map((each) => each.name));
    Object.keys(state.craft).filter((name) => !there.has(name)).forEach((name) => {
      const gone = state.craft[name];
      gone.pieces.forEach((piece) => piece.line.remove());
      if (gone.marker) gone.marker.remove();
      delete state.craft[name];
    });
    broad(given.commanding);
    const count = Object.keys(state.craft).length;
    if (!state.moved && (!state.fitted || count !== state.seen)) {
      state.fitted = fit();
      state.seen = count;
    }
  }

  function focus(name) {
    const known = state.craft[name];
    if (!known || !known.at) return;
    state.moved = true;
    state.map.setView(known.at, Math.max(state.map.getZoom(), 15));
  }

  return { attach, show, focus };
})();
