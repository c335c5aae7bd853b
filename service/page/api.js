// The REST interface, by addresses relative to the page: JSON answers, and problems (RFC 9457) as errors that say what was wrong.

export class Problem extends Error {
  constructor(status, detail, body = null) {
    super(detail);
    this.status = status;
    this.body = body;
  }
}

// JSON whose texts hold nothing that steers, or reverses the text next to it, as `service/printable.py`; lines stay.
export const parsed = (text) => JSON.parse(text, (_, value) =>
  typeof value === "string" ? value.replace(/(?![\n\t\u200c\u200d])[\p{C}\p{Zl}\p{Zp}]/gu, "?") : value);

const UNREACHABLE = "The service does not answer. Check that it is running and that this computer can reach it.";

async function answerOf(path, given) {
  let answer;
  try {
    // "no-cache" asks with the ETag of the copy at hand: what has not changed is not sent again
    answer = await fetch(path, { cache: "no-cache", ...given });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem(0, UNREACHABLE);
  }
  const text = await answer.text();
  let body = null;
  try {
    body = text ? parsed(text) : null;
  } catch {
    throw new Problem(answer.status, `The service gave no readable answer (status ${answer.status}).`);
  }
  if (!answer.ok) throw new Problem(answer.status, body?.detail ?? `The service answered with status ${answer.status}.`, body);
  const next = answer.headers.get("Link")?.match(/<\/?([^>]+)>; rel="next"/)?.[1] ?? null;
  return { status: answer.status, body, next };
}

export async function get(path, { signal } = {}) {
  return (await answerOf(path, { signal, headers: { Accept: "application/json" } })).body;
}

// A page of a list, and the address of the next one; null at the end.
export async function getPage(path, { signal } = {}) {
  const { body, next } = await answerOf(path, { signal, headers: { Accept: "application/json" } });
  return { list: body, next };
}

// Sends JSON; the answer's status and body.
export async function send(method, path, body, { signal } = {}) {
  const headers = { Accept: "application/json", "Content-Type": "application/json" };
  return answerOf(path, { method, signal, headers, body: body === undefined ? undefined : JSON.stringify(body) });
}

// Passes on why something failed; nothing where the view was left meanwhile.
export const unlessLeft = (pass) => (error) => {
  if (error.name !== "AbortError") pass(error.message);
};
export const warned = unlessLeft((text) => console.warn(text));

// The address of a machine's view on the page, and that of its answers.
export const addressOf = (asset, view = "") => `#/asset/${encodeURIComponent(asset)}${view ? `/${view}` : ""}`;
export const pathOf = (asset, ...parts) =>
  ["v1/assets", encodeURIComponent(asset), ...parts.map(encodeURIComponent)].join("/");

// Asks in turn; the answer, or null where one that was asked for later has come first, so that no old state is drawn.
export function newestOf(ask) {
  let [asked, answered] = [0, 0];
  return async (...given) => {
    asked += 1;
    const own = asked;
    const answer = await ask(...given);
    if (own < answered) return null;
    answered = own;
    return answer;
  };
}
