/** Types of the part of fft.js that is used; the package has no types. */
declare module "fft.js" {
  export default class FFT {
    constructor(size: number);
    createComplexArray(): number[];
    /** Fills the first half of the spectrum, `size / 2` included. */
    realTransform(output: number[], input: readonly number[]): void;
  }
}
