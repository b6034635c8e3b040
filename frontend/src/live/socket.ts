/** Connects the link state machine to a WebSocket and feeds the store. */

import { heldKey, noteHolder } from "../wire/control";
import { decodeFrame, parseMessage } from "../wire/liveMessages";
import { type LinkEvent, step } from "./link";
import type { LiveStore } from "./store";

const CLOCK_MS = 250;

/** Opens the connection and reopens it after each loss; returns a function that closes it. */
export function connectStore(store: LiveStore, url: string): () => void {
  let socket: WebSocket | null = null;
  let pings = 0;
  const sent = new Map<number, number>();

  function happen(event: LinkEvent): void {
    const now_ms = performance.now();
    const [link, action] = step(store.snapshot().link, event, now_ms);
    store.setLink(link);
    if (action === "connect") connect();
    if (action === "drop") drop();
    if (action === "ping" && socket?.readyState === WebSocket.OPEN) {
      pings += 1;
      sent.set(pings, now_ms);
      socket.send(JSON.stringify({ type: "ping", id: pings, control: heldKey() }));
    }
  }

  function connect(): void {
    drop();
    const fresh = new WebSocket(url);
    fresh.binaryType = "arraybuffer";
    fresh.onopen = () => happen({ kind: "opened" });
    fresh.onclose = () => happen({ kind: "closed" });
    fresh.onmessage = (message: MessageEvent<ArrayBuffer | string>) => receive(message.data);
    socket = fresh;
  }

  function drop(): void {
    if (socket === null) return;
    socket.onopen = null;
    socket.onclose = null;
    socket.onmessage = null;
    socket.close();
    socket = null;
    sent.clear();
  }

  function receive(data: ArrayBuffer | string): void {
    if (typeof data === "string") {
      receiveText(data);
      return;
    }
    const layout = store.snapshot().layout;
    if (layout !== null) store.addFrame(decodeFrame(data, layout.fields.length), performance.now() / 1000);
  }

  function receiveText(text: string): void {
    const message = parseMessage(text);
    if (message?.type === "pong") {
      const sent_ms = sent.get(message.id);
      sent.delete(message.id);
      happen(sent_ms === undefined ? { kind: "received" } : { kind: "pong", sent_ms });
      return;
    }
    happen({ kind: "received" });
    // The browser slows the timers of a page in the background, so each message also checks the clock.
    happen({ kind: "clock" });
    if (message?.type === "layout") store.setLayout(message);
    if (message?.type === "state") {
      noteHolder(message.holder?.epoch ?? null);
      store.setState(message);
    }
    if (message?.type === "event") store.addMark(message);
  }

  const wake = () => happen({ kind: "wake" });
  const clock = window.setInterval(() => happen({ kind: "clock" }), CLOCK_MS);
  window.addEventListener("online", wake);
  document.addEventListener("visibilitychange", wake);
  connect();

  return () => {
    window.clearInterval(clock);
    window.removeEventListener("online", wake);
    document.removeEventListener("visibilitychange", wake);
    drop();
  };
}
