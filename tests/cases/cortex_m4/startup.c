/* What a Cortex-M4 does before the C library starts: the table of vectors, and leave to use the FPU. */
void _start(void);
void reset(void);
void _init(void);
void _fini(void);

extern char __stack[];

__attribute__((section(".vectors"), used)) static const struct {
    void *stack;
    void (*handlers[3])(void); /* reset, NMI, hard fault */
} vectors = {__stack, {reset, reset, reset}};

__attribute__((naked)) void reset(void)
{
    /* full access to the coprocessors 10 and 11 in CPACR */
    __asm volatile("ldr r0, =0xE000ED88\n"
                   "ldr r1, [r0]\n"
                   "orr r1, r1, #0xF00000\n"
                   "str r1, [r0]\n"
                   "dsb\n"
                   "isb\n"
                   "b _start\n");
}

void _init(void)
{
}

void _fini(void)
{
}
