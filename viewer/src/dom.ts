export function el<T extends HTMLElement = HTMLElement>(id: string): T {
  const found = document.getElementById(id);
  if (!found) throw new Error(`no element ${id}`);
  return found as T;
}

type Child = Node | string;

export function make<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Record<string, string> = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

export function svg(tag: string, attributes: Record<string, string | number>, ...children: Node[]): SVGElement {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

export function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export function options(select: HTMLSelectElement, items: { value: string; label: string; group?: string }[], chosen: string): void {
  select.replaceChildren();
  let group: HTMLOptGroupElement | undefined;
  for (const item of items) {
    const option = make("option", { value: item.value }, item.label);
    option.selected = item.value === chosen;
    if (item.group && item.group !== (group as HTMLOptGroupElement | undefined)?.label) {
      group = make("optgroup", { label: item.group });
      select.append(group);
    }
    (item.group ? group! : select).append(option);
  }
}

/** Fit a canvas's pixels to its size on the screen; gives its context in CSS pixels, or in larger ones. */
export function fitted(canvas: HTMLCanvasElement, enlarged = 1): { context: CanvasRenderingContext2D; width: number; height: number; density: number } {
  const density = (window.devicePixelRatio || 1) * enlarged;
  const [width, height] = [canvas.clientWidth / enlarged, canvas.clientHeight / enlarged];
  const [w, h] = [Math.max(Math.round(width * density), 1), Math.max(Math.round(height * density), 1)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = canvas.getContext("2d")!;
  context.setTransform(density, 0, 0, density, 0, 0);
  return { context, width, height, density };
}

export const digits = (value: number | null | undefined, count = 3): string =>
  value === null || value === undefined || !Number.isFinite(value)
    ? "–"
    : String(Number(value.toPrecision(count))).replace(/^-/, "\u2212");

export const fixed = (value: number, count: number): string => value.toFixed(count).replace(/^-/, "\u2212");

/** No line ends between a number and its unit. */
export const unbroken = (words: string): string => words.replace(/(?<=\d) /g, "\u00a0");

export function checkRadio(name: string, value: string): void {
  for (const input of document.querySelectorAll<HTMLInputElement>(`input[name="${name}"]`)) input.checked = input.value === value;
}
