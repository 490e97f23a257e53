// The server: one request, one answer; what it refuses becomes an Error with its sentence.

async function checked(response) {
  if (response.ok) return response;
  let sentence = `the server answered ${response.status}`;
  try { sentence = (await response.json()).error ?? sentence; } catch { /* no JSON: the status says it */ }
  throw Object.assign(new Error(sentence), { refused: true });
}

async function send(address, options) {
  let response;
  try {
    response = await fetch(address, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("the server does not answer; is exosight lab still running?");
  }
  return checked(response);
}

const asJson = (settings, signal) => ({
  method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(settings), signal,
});

export const about = async () => (await send("/api/about", {})).json();
export const ask = async (address, settings, signal) => (await send(address, asJson(settings, signal))).json();
export const file = async (address, settings) => (await send(address, asJson(settings))).blob();
export const asPng = async (picture) => (await send("/api/png", { method: "POST", body: picture })).blob();
export const upload = async (picture) => (await send("/api/estimate", { method: "POST", body: picture })).json();

/** The lines of an answer, each as soon as it is there. */
export async function* lines(address, settings, signal) {
  const response = await send(address, asJson(settings, signal));
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    const parts = (rest + value).split("\n");
    rest = parts.pop();
    for (const part of parts) yield JSON.parse(part);
  }
}
